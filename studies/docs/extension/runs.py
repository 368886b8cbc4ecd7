"""Records of the built-in plants without and with each effect: the same reference, the same controller.

All effects of a plant stand in one model, each at its null but one, so that its equations are compiled once. The runs
go side by side, a block of samples at a time; between blocks the controller looks at what the sensor says.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from optid.core.model import CLOCK, INTERVAL, Array, Model
from optid.core.sheet import build
from optid.core.simulation import simulate
from optid.effects.anywhere import Anywhere
from optid.effects.effect import Effect
from optid.effects.library import admitted
from optid.rigs import BUILT_IN, find_plant
from optid.rigs.rigfile import read_rig

DATA = Path(__file__).resolve().parents[3] / "data"
# The pages' own plant, for what built-in ones have no site for.
OWN = Path(__file__).resolve().parents[1] / "own"
Law = Callable[
    [int, Array], Array
]  # first sample of a block, measured so far (runs, samples) -> command (runs,)


@dataclass(frozen=True)
class Excitation:
    """How a plant is driven.

    Attributes:
        file: rig file of the plant's folder.
        step: s between samples.
        samples: how many.
        hold: samples of a block, within which the command stands.
        reference: what is to be followed, SI, (samples,); the command itself where there is no controller.
        law: the controller.
        noise: usual sd of the sensors, SI, by output.
        closed: the reference is followed; else it is the command.
    """

    file: str
    step: float
    samples: int
    hold: int
    reference: Array
    law: Law
    noise: dict[str, float]
    closed: bool = True


@dataclass(frozen=True, eq=False)
class Record:
    """What one effect does: the first row of each array is without it, the second with it.

    Attributes:
        values: the effect's parameters, SI, by own name.
        command: (2, samples), `outputs` (2, samples, outputs), SI.
        command_unit: SI; "1" for a share of full command.
    """

    effect: Effect
    plant: str
    values: dict[str, float]
    excitation: Excitation
    roles: tuple[str, ...]
    units: tuple[str, ...]
    command: Array
    outputs: Array
    command_unit: str

    @property
    def change(self) -> Array:
        """Difference that it makes, in sd of the sensors' noise, (samples, outputs)."""
        noise = np.array([self.excitation.noise[role] for role in self.roles])
        return np.asarray((self.outputs[1] - self.outputs[0]) / noise)

    @property
    def column(self) -> int:
        """The output to show: the first one if the change is plain there, else that with the largest."""
        largest = np.nan_to_num(np.abs(self.change)).max(axis=0)
        return 0 if largest[0] > 20 else int(np.argmax(largest))


def records() -> Iterator[Record]:
    """One for each effect and kind of effect, on the first plant that admits it."""
    seen: set[str] = set()
    for plant, ways in EXCITATIONS.items():
        left = _not_seen(plant, seen)
        for n, excitation in enumerate(ways()):
            if not left:
                break
            shown = [one for one in _runs(plant, left, excitation) if n + 1 == len(ways()) or _plain(one)]
            yield from shown
            done = {one.effect.name for one in shown}
            left = [effect for effect in left if effect.name not in done]


def key(effect: Effect) -> str:
    """The name under which an effect has its page: without the site that it was made for."""
    return effect.kind if isinstance(effect, Anywhere) else effect.name


def _not_seen(plant: str, seen: set[str]) -> list[Effect]:
    found = []
    for effect in admitted(build(find_plant(plant, _folder(plant)))):
        if key(effect) not in seen:
            seen.add(key(effect))
            found.append(effect)
    return found


def _folder(plant: str) -> Path:
    return DATA if plant in BUILT_IN else OWN


def _plain(record: Record) -> bool:
    return bool(np.nanmax(np.abs(record.change)) > 20)


def _runs(plant: str, effects: list[Effect], excitation: Excitation) -> list[Record]:
    folder = _folder(plant)
    rig = read_rig(folder / excitation.file)
    model = build(find_plant(plant, folder), tuple(effects), **rig.options)
    given = dict(rig.parameters)
    points = [dict(effect.usual[len(effect.usual) // 2]) for effect in effects]
    sets = [{}, *(e.qualified(point) for e, point in zip(effects, points, strict=True))]
    P = np.array([model.vector({**given, **own}) for own in sets])
    u, y = _driven(model, P, excitation)
    unit = next(port.unit for port in model.inputs if port.role == "command")
    roles, units = zip(*((port.role, port.unit) for port in model.outputs), strict=True)
    return [
        Record(effect, plant, values, excitation, roles, units, u[[0, n]], y[[0, n]], unit)
        for n, (effect, values) in enumerate(zip(effects, points, strict=True), 1)
    ]


def _driven(model: Model, P: Array, e: Excitation) -> tuple[Array, Array]:
    """Commands (runs, samples) and outputs (runs, samples, outputs)."""
    runs, rows = len(P), e.hold + 1
    u, y = np.zeros((runs, e.samples)), np.zeros((runs, e.samples, len(model.outputs)))
    x = np.array([np.array(model.start(p)[0]).ravel() for p in P])
    first = np.arange(runs) * rows
    for k in range(0, e.samples, e.hold):
        seen = y[:, :k, 0] if k else np.zeros((runs, 0))
        u[:, k : k + e.hold] = e.law(k, seen)[:, None]
        inputs = np.concatenate([_inputs(model, own, k, e) for own in u])
        found = simulate(model, P, x, np.full(len(inputs), e.step), inputs, first=first, intervals=e.hold)
        y[:, k : k + e.hold], x = found.outputs[:, :-1], found.states[:, -1]
    return u, y


def _inputs(model: Model, u: Array, k: int, e: Excitation) -> Array:
    rows = np.arange(k, k + e.hold + 1)
    columns = []
    for port in model.inputs:
        if port.role == INTERVAL:
            columns.append(np.full(len(rows), e.step))
        elif port.role == CLOCK:
            columns.append((rows + 0.5) * e.step)
        else:
            columns.append(u[np.clip(rows - port.ago, 0, min(k + e.hold, e.samples) - 1)])
    return np.column_stack(columns)


def _path(moves: tuple[tuple[float, float], ...], samples: int, step: float) -> Array:
    """Smooth moves (seconds, to), each followed by a rest of 0.3 s."""
    parts, at = [], 0.0
    for seconds, to in moves:
        s = np.linspace(0.0, 1.0, round(seconds / step))
        parts += [at + (to - at) * s**3 * (10 - 15 * s + 6 * s**2), np.full(round(0.3 / step), to)]
        at = to
    return np.r_[np.concatenate(parts), np.full(samples, at)][:samples]


AXIS = (
    (1.2, 0.012),
    (0.5, 0.07),
    (0.6, -0.06),
    (1.2, -0.045),
    (0.8, 0.1),
    (0.6, -0.1),
    (0.5, 0.128),
    (0.8, -0.128),
)


def _axis() -> list[Excitation]:
    """Slow ramps, quick moves and both ends under a proportional controller; full strokes at full command."""
    step, samples, gain = 1e-3, 10000, 7.0
    reference = _path(AXIS, samples, step)
    strokes = np.where(np.arange(samples) % 1000 < 500, 1.0, -1.0)
    noise = {"position": 3e-5, "pressure_a": 1e3, "pressure_b": 1e3}

    def follow(k: int, seen: Array) -> Array:
        return np.asarray(np.clip(gain * (reference[k] - _last(seen)), -1.0, 1.0))

    def stroke(k: int, seen: Array) -> Array:
        return np.full(len(seen), strokes[k])

    return [
        Excitation("table1.toml", step, samples, 10, reference, follow, noise),
        Excitation("table1.toml", step, samples, 10, strokes, stroke, noise, closed=False),
    ]


def _drive() -> list[Excitation]:
    """The electro-mechanical axis under proportional and derivative action, V."""
    step, samples, hold = 1e-3, 6000, 5
    reference = _path(((0.6, 0.02), (0.4, 0.09), (0.8, -0.08), (1.0, -0.06), (0.4, 0.0)), samples, step)

    def follow(k: int, seen: Array) -> Array:
        back = seen[:, -1 - hold] if k > hold else _last(seen)
        speed = (_last(seen) - back) / (hold * step)
        return np.asarray(np.clip(400.0 * (reference[k] - _last(seen)) - 40.0 * speed, -10.0, 10.0))

    return [Excitation("emps.toml", step, samples, hold, reference, follow, {"position": 1e-5})]


def _tanks() -> list[Excitation]:
    """Steps of the pump's voltage that fill the upper tank to its rim."""
    step, samples, hold = 4.0, 600, 20
    levels = np.repeat(np.array([3.0, 5.0, 2.0, 7.0, 1.0, 6.0, 4.0, 8.0, 2.0, 5.0]), samples // 10)

    def pump(k: int, seen: Array) -> Array:
        return np.full(len(seen), levels[k])

    return [
        Excitation("cascaded_tanks.toml", step, samples, hold, levels, pump, {"level": 0.02}, closed=False)
    ]


def _winch() -> list[Excitation]:
    """Steps of the drive's voltage that stretch the spring."""
    step, samples, hold = 5e-3, 1600, 80
    volts = np.repeat(np.array([2.0, -3.0, 5.0, -6.0, 8.0, 1.0, -8.0, 4.0, 6.0, -2.0]), samples // 10)

    def drive(k: int, seen: Array) -> Array:
        return np.full(len(seen), volts[k])

    return [Excitation("winch.toml", step, samples, hold, volts, drive, {"position": 2e-5}, closed=False)]


def _last(seen: Array) -> Array:
    return np.asarray(seen[:, -1]) if seen.shape[1] else np.zeros(len(seen))


def _arm() -> list[Excitation]:
    """The rotary axis under proportional and derivative action, V."""
    step, samples, hold = 1e-3, 6000, 5
    moves = ((1.5, 0.15), (0.3, 1.0), (0.6, -0.8), (1.0, -0.7), (0.4, 0.0))
    reference = _path(moves, samples, step)

    def follow(k: int, seen: Array) -> Array:
        back = seen[:, -1 - hold] if k > hold else _last(seen)
        speed = (_last(seen) - back) / (hold * step)
        return np.asarray(np.clip(40.0 * (reference[k] - _last(seen)) - 1.5 * speed, -12.0, 12.0))

    return [Excitation("rotary_axis.toml", step, samples, hold, reference, follow, {"position": 3e-4})]


def _cylinder() -> list[Excitation]:
    """The servo-hydraulic axis under a proportional controller."""
    step, samples = 1e-3, 6000
    moves = ((1.0, 0.01), (0.4, 0.06), (0.8, -0.06), (1.0, -0.05), (0.5, 0.07))
    reference = _path(moves, samples, step)

    def follow(k: int, seen: Array) -> Array:
        return np.asarray(np.clip(10.0 * (reference[k] - _last(seen)), -1.0, 1.0))

    noise = {"position": 2e-5, "pressure_a": 2e4, "pressure_b": 2e4}
    return [Excitation("servo_hydraulic.toml", step, samples, 5, reference, follow, noise)]


EXCITATIONS: dict[str, Callable[[], list[Excitation]]] = {
    "servo-pneumatic": _axis,
    "emps": _drive,
    "cascaded-tanks": _tanks,
    "rotary-axis": _arm,
    "servo-hydraulic": _cylinder,
    "winch.py:winch": _winch,
}
