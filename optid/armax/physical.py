"""The poles of the rig's own equations, linearised at a recording's operating point, to interpret identified poles."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np

from optid.armax.model import Armax
from optid.core.model import Array
from optid.core.recording import Recording
from optid.errors import OptidError
from optid.rigs.rigfile import Rig

SHARE = 0.2  # participation in a mode from which a state is named


@dataclass(frozen=True)
class PhysicalPole:
    """A pole of the linearised rig and the identified pole nearest to it.

    Attributes:
        pole: 1/s; `discrete` is exp(pole T).
        states: participating states, largest share first.
        nearest: the identified pole in z.
        distance: between the two in z.
    """

    pole: complex
    discrete: complex
    states: tuple[str, ...]
    nearest: complex
    distance: float

    @property
    def words(self) -> str:
        """Time constant or frequency, in words."""
        if abs(self.pole) < 1e-6:
            return "integrates"
        if self.pole.imag:
            damping = -self.pole.real / abs(self.pole)
            return f"{abs(self.pole) / (2 * math.pi):.3g} Hz, damping ratio {damping:.2g}"
        kind = "time constant" if self.pole.real < 0 else "unstable, with a time constant of"
        return f"{kind} {1e3 / abs(self.pole.real):.3g} ms"


def physical_poles(
    rig: Rig, recording: Recording, output: str, model: Armax
) -> tuple[tuple[PhysicalPole, ...], str]:
    """Poles of the rig at the recording's mean output, moving at its root mean square speed.

    Returns:
        the poles, slowest first, and the operating point in words; or none, and why.
    """
    from optid.core.linearise import linearise

    plant = rig.model
    names = [state.name for state in plant.states]
    if output not in names:
        return (), f"the rig's equations have no state {output} to linearise at"
    y = recording[output].values
    moves = _speed_of(rig, names, output)
    values = {p.name: float(x) for p, x in zip(plant.parameters, plant.vector(rig.parameters), strict=True)}
    held = {output: float(np.nanmean(y))}
    if moves is not None:
        measured = np.isfinite(y)  # an output with a slower rate has no value at every sample
        held[moves] = float(np.sqrt(np.mean(np.gradient(y[measured], recording.time[measured]) ** 2)))
    try:
        point = linearise(plant, values, held, moving=() if moves is None else (output,), near=_near(rig))
    except OptidError as error:
        return (), f"the rig could not be linearised where the recording lies: {error}"
    said = ", ".join(f"{name.replace('_', ' ')} {value:.3g}" for name, value in held.items())
    return _matched(np.asarray(point.system.A), names, model), f"linearised at {said} (SI)"


def _near(rig: Rig) -> dict[str, float]:
    """Guess at the side of small positive inputs, where laws change at zero."""
    return {port.role: 0.05 for port in rig.model.inputs if not port.ago}


def _speed_of(rig: Rig, names: list[str], output: str) -> str | None:
    """The state that is the output's rate, if one is."""
    plant = rig.model
    p, u = plant.vector(rig.parameters), np.full(len(plant.inputs), 0.05)
    x = np.array(plant.start(p)[0]).ravel()
    row = names.index(output)

    def rate(state: Array) -> float:
        return float(np.array(plant.rates(state, u, p)).ravel()[row])

    slopes = [rate(x + scale * np.eye(len(x))[j]) - rate(x) for j, scale in enumerate(plant.scales)]
    moved = np.array(slopes) / plant.scales
    alone = np.flatnonzero(np.abs(slopes) > 1e-9)
    return names[int(alone[0])] if alone.size == 1 and abs(moved[alone[0]] - 1.0) < 1e-6 else None


def _matched(A: Array, names: list[str], model: Armax) -> tuple[PhysicalPole, ...]:
    values, right = np.linalg.eig(A)
    left = np.linalg.pinv(right)
    identified = np.roots(np.array(model.a)).astype(complex)
    found = []
    for k in np.argsort(np.abs(values)):
        pole = complex(values[k])
        if pole.imag < 0.0 or not identified.size:
            continue
        parts = np.abs(right[:, k] * left[k])
        parts = parts / max(float(parts.sum()), 1e-300)
        order = [int(i) for i in np.argsort(-parts) if parts[i] >= SHARE]
        discrete = cmath.exp(pole * model.sample_time)
        nearest = complex(identified[int(np.argmin(np.abs(identified - discrete)))])
        states = tuple(names[i].replace("_", " ") for i in order)
        found.append(PhysicalPole(pole, discrete, states, nearest, abs(nearest - discrete)))
    return tuple(found)
