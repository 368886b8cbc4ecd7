"""A simulated rig, with physics that the rig file's model does not have."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from optid.core.model import Array
from optid.core.quantity import quantity
from optid.effects.library import admitted
from optid.errors import RigError, SolveError
from optid.live.driver import Order
from optid.live.settings import Settings, Wiring
from optid.live.twin import Twin
from optid.rigs.fields import known_keys, text
from optid.rigs.rigfile import Rig, read_rig, with_effects

# Effects of the simulated rig that the model lacks, where the plant offers the sites; all three are common.
UNKNOWN = {
    "stribeck_friction": {"breakaway_ratio": 1.3, "stribeck_speed": 0.03},
    "valve_lag": {"time_constant": 2e-3, "damping_ratio": 0.8},
    "ambient_leakage": {},
}
OFF = 0.08  # factor by which fitted parameters differ, up or down
NOISE = 1e-4  # sd of a sensor as a share of the stroke limits, or of its first value, where none is stated


class Simulated:
    """A `Twin` of another model as a driver, with sensor noise.

    Args:
        rig: the rig that is simulated.
        wiring, settings: of the session.
        rng: source of the noise.
        hides: differences of the rig from the session's rig file, in words.
    """

    def __init__(
        self, rig: Rig, wiring: Wiring, settings: Settings, rng: np.random.Generator, hides: str = ""
    ) -> None:
        self.hides = hides
        self._twin, self._wiring, self._rng = Twin(rig.model, rig.model.vector(rig.parameters)), wiring, rng
        names = [port.role for port in rig.model.outputs]
        missing = [c.role for c in wiring.measured if c.role not in names]
        if missing:
            raise RigError(f"no output {', '.join(missing)}", where=rig.path, field="model")
        self._pick = [names.index(c.role) for c in wiring.measured]
        first, (low, high) = self._twin.outputs(), settings.limits.stroke
        self._sd: Array = np.array(
            [
                c.sd
                if c.sd is not None
                else NOISE * (high - low)
                if j == 0 and math.isfinite(high - low)
                else NOISE * abs(first[k])
                for j, (c, k) in enumerate(zip(wiring.measured, self._pick, strict=True))
            ]
        )
        self._command, self._time = wiring.command.factor * wiring.put(settings.limits.safe), 0.0

    def read(self, time: float) -> Sequence[float]:
        """Simulate up to `time` and return noisy measurements."""
        self._reach(time)
        values = self._twin.outputs()[self._pick] + self._sd * self._rng.standard_normal(len(self._sd))
        return [
            float((value - c.shift) / c.factor)
            for value, c in zip(values, self._wiring.measured, strict=True)
        ]

    def write(self, command: float, time: float) -> float:
        """Apply the command from now on."""
        self._reach(time)
        channel = self._wiring.command
        self._command = channel.factor * command + channel.shift
        return command

    def close(self) -> None:
        """Nothing to close."""

    def _reach(self, time: float) -> None:
        # In steps of at most a millisecond: states of delays and lags are written for held samples.
        while time - self._time > 1e-9:
            span = min(time - self._time, 1e-3)
            if not self._twin.advance(self._command, span):
                raise SolveError("the simulated rig diverged (NaN or infinite)")
            self._time += span


def simulated(order: Order) -> Simulated:
    """The rig of `[live.simulated] rig = "other.toml"`, or the session's own with physics that it lacks."""
    known_keys(order.options, ("rig",), order.rig.path, "live.simulated.")
    rng = np.random.default_rng(order.seed)
    if order.options:
        name = text(order.options, "rig", order.rig.path, "live.simulated.rig", "a rig file")
        rig = read_rig(order.rig.path.parent / name)
    else:
        rig = unlike(order.rig, rng)
    return Simulated(rig, order.wiring, order.settings, rng, differences(order.rig, rig))


def differences(stated: Rig, real: Rig) -> str:
    """Differences between two rigs: effects with their parameters, and parameters with other values."""
    known = {effect.name for effect in stated.effects}
    one, other = (_values(rig) for rig in (stated, real))
    units = {p.name: p.unit for p in real.model.parameters}
    found = []
    for effect in real.effects:
        if effect.name not in known:
            own = {q.name: f"{effect.name}.{q.name}" for q in effect.parameters}
            shown = [
                f"{name.replace('_', ' ')} {_value(other[key], units[key])}" for name, key in own.items()
            ]
            found.append(f"{effect.name.replace('_', ' ')} ({', '.join(shown)})")
    for name, value in one.items():
        if name in other and other[name] != value:
            of = f"{_value(other[name], units[name])} instead of {_value(value, units[name])}"
            found.append(f"{name.replace('_', ' ')} {of}")
    return "; ".join(found)


def _values(rig: Rig) -> dict[str, float]:
    vector = rig.model.vector(rig.parameters).tolist()
    return dict(zip((p.name for p in rig.model.parameters), vector, strict=True))


def _value(value: float, unit: str) -> str:
    return quantity(value, unit, 4)


def unlike(rig: Rig, rng: np.random.Generator) -> Rig:
    """The rig with other values of its fitted parameters, and with effects of the catalogue."""
    effects = [effect for effect in admitted(rig.model) if effect.name in UNKNOWN]
    values: dict[str, float] = {}
    for effect in effects:
        values |= effect.qualified({**effect.usual[0], **UNKNOWN[effect.name]})
    for freed in rig.freed:
        nominal = rig.parameters.get(freed.name)
        if nominal is not None:
            other = nominal * (1 + OFF * float(rng.choice((-1.0, 1.0))))
            values[freed.name] = min(max(other, freed.low), freed.high)
    return with_effects(rig, effects, values)
