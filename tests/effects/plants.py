"""The built-in plants with every effect they admit, and points of their state space to hold them to."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from optid.core.model import CLOCK, INTERVAL, Model
from optid.core.sheet import build
from optid.effects.effect import Effect
from optid.effects.library import admitted
from optid.rigs.cascaded_tanks import cascaded_tanks
from optid.rigs.emps import emps
from optid.rigs.rigfile import read_rig
from optid.rigs.rotary_axis import rotary_axis
from optid.rigs.servo_hydraulic import servo_hydraulic
from optid.rigs.servo_pneumatic import servo_pneumatic

DATA = Path(__file__).parents[2] / "data"
PLANTS = {
    "servo-pneumatic": (servo_pneumatic, "table1.toml"),
    "emps": (emps, "emps.toml"),
    "cascaded-tanks": (cascaded_tanks, "cascaded_tanks.toml"),
}
MACHINES = PLANTS | {
    "rotary-axis": (rotary_axis, "rotary_axis.toml"),
    "servo-hydraulic": (servo_hydraulic, "servo_hydraulic.toml"),
}
# Usual ranges of what the plants' states do, SI.
RANGES = {
    "position": (-0.125, 0.125),
    "velocity": (-1.0, 1.0),
    "bristle": (-1.0, 1.0),
    "pressure_a": (1.2e5, 6.9e5),
    "pressure_b": (1.2e5, 6.9e5),
    "upper_level": (0.0, 16.0),
    "lower_level": (0.0, 9.9),
}
OTHER = {
    "rotary-axis": {"position": (-1.2, 1.2), "velocity": (-8.0, 8.0)},
    "servo-hydraulic": {
        "position": (-0.09, 0.09),
        "velocity": (-0.3, 0.3),
        "pressure_a": (4e5, 9.5e6),
        "pressure_b": (4e5, 9.5e6),
    },
}
FULL = {
    "servo-pneumatic": 1.0,
    "emps": 10.0,
    "cascaded-tanks": 10.0,
    "rotary-axis": 12.0,
    "servo-hydraulic": 1.0,
}
SAMPLE = {"cascaded-tanks": 4.0}  # s; 1 ms else


@dataclass(frozen=True, eq=False)
class Grown:
    """A plant without and with effects; the parameters of the plain one."""

    name: str
    plain: Model
    model: Model
    effects: tuple[Effect, ...]
    values: dict[str, float]

    @property
    def shared(self):
        """Where the plain plant's states and inputs stand in the grown one's."""
        own, every = ([state.name for state in m.states] for m in (self.plain, self.model))
        ports = [(port.role, port.ago) for port in self.model.inputs]
        return [every.index(s) for s in own], [ports.index((q.role, q.ago)) for q in self.plain.inputs]

    def states(self, rng, count):
        """Random states of the grown model, (count, states); those of effects within three of their scales."""
        columns = []
        for state in self.model.states:
            ranges = {**RANGES, **OTHER.get(self.name, {})}
            low, high = ranges.get(state.name, (-3 * state.scale, 3 * state.scale))
            if state.unit == "K":
                low, high = 270.0, 320.0
            columns.append(rng.uniform(low, high, count))
        return np.column_stack(columns)

    def inputs(self, rng, count):
        """Random inputs of the grown model: full commands, their own past, the clock."""
        columns = []
        for port in self.model.inputs:
            full = FULL[self.name]
            sample = SAMPLE.get(self.name, 1e-3)
            span = {INTERVAL: (0.9 * sample, sample), CLOCK: (0.0, 20.0)}.get(port.role, (-full, full))
            columns.append(rng.uniform(*span, count))
        return np.column_stack(columns)

    def vector(self, own=None):
        """Parameters with effects at their null, or with an effect's own at these values by full name."""
        return self.model.vector({**self.values, **(own or {})})


@cache
def grown(name, effect=None):
    """A plant with one effect, or with all it admits."""
    plant, file = MACHINES[name]
    rig = read_rig(DATA / file)
    plain = build(plant, **rig.options)
    effects = tuple(e for e in admitted(plain) if effect in (None, e.name))
    return Grown(name, plain, build(plant, effects, **rig.options), effects, dict(rig.parameters))
