"""How well an effect hides: what a refit of the base parameters would leave of it, and when it acts.

All from the independent rig itself: the true path, the path without the effect from the same states, and what the
base parameters, a skew between the channels and the states at each window's start can do about the difference.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from studies.independent_rig import Rig, Run, replay, simulate
from studies.independent_rig.rig import Array
from studies.independent_rig.states import CREEP_A, CREEP_B, GEAR, PA, PB, SEEN, SEEN2, V2, WAY, X2, V, X
from studies.trial.case import Case, Hidden
from studies.trial.record import DT, HELD_OUT, TRAIN, Recorded, wanted

WINDOW = 500  # samples
STRIDE, HORIZON = 5, 5  # samples between, and length of, the short replays that show when an effect acts
STEP = 5e-5
SKEW = 0.2  # samples by which the position is read later
BASE = ("viscous", "coulomb", "discharge", "residual_length")
NUDGES = {X: 5e-5, V: 5e-3, PA: 1e3, PB: 1e3}  # m, m/s, Pa
ALONG = {
    X: (X, X2, SEEN, SEEN2, GEAR),
    V: (V, V2),
    PA: (PA, CREEP_A),
    PB: (PB, CREEP_B),
}  # what moves together
AREA = 1.3e-3  # m2: makes forces of pressures
UNSEEN = 10.0  # sd: a trace too faint to be asked for
FAINT, MOST, SELDOM, SAME = 0.05, 0.9, 0.1, 0.05  # limits of rise, absorption, time, and change of tracking


@dataclass(frozen=True)
class Trace:
    """What an effect leaves in the recordings for fitting, in standard deviations of the noise.

    Attributes:
        raw: norm of the difference it makes.
        left: norm after base parameters and window starts have done what they can (linearised).
        absorbed: share of the energy that a refit takes.
        rise: by how much the RMSE rises above the noise after the refit, as a share.
    """

    raw: float
    left: float
    absorbed: float
    rise: float


def trace(recorded: Recorded, without: Case) -> Trace:
    """The trace of what `without` lacks, over the recordings for fitting."""
    blocks = [
        _window(recorded.case, run, without, first)
        for name, run in recorded.runs.items()
        if name != HELD_OUT
        for first in range(0, len(run.t) - WINDOW, WINDOW)
    ]
    raw = float(np.sqrt(sum(np.sum(d**2) for d, _, _ in blocks)))
    rest, columns = [], []
    for d, shared, own in blocks:
        q, _ = np.linalg.qr(own)
        rest.append(d - q @ (q.T @ d))
        columns.append(shared - q @ (q.T @ shared))
    d, tangents = np.concatenate(rest), np.concatenate(columns)
    left = float(np.linalg.norm(d - tangents @ np.linalg.lstsq(tangents, d, rcond=None)[0]))
    absorbed = 1.0 - (left / raw) ** 2 if raw > 0.0 else 0.0
    return Trace(raw, left, absorbed, float(np.sqrt(1.0 + left**2 / len(d)) - 1.0))


def _window(case: Case, run: Run, without: Case, first: int) -> tuple[Array, Array, Array]:
    """Difference, tangents of what is fitted, tangents of the start: in sd, stacked channels."""
    y, drift = run.states[first], without.recorded_with.clock_drift

    def path(rig: Rig, start: Array, late: float = 0.0) -> Array:
        clean, states = read(case, rig, drift, run.command, start, first, WINDOW, late)
        return _scaled(case, clean, states)

    plain = path(without.rig, y)
    shared = [path(_scaled_up(without.rig, name), y) - plain for name in BASE]
    shared.append(path(without.rig, y, SKEW) - plain)
    own = [path(without.rig, moved(y, {index: nudge})) - plain for index, nudge in NUDGES.items()]
    at = (first + np.arange(WINDOW)) * (1.0 + case.recorded_with.clock_drift)
    seen = np.interp(at, np.arange(len(run.t)), run.clean)
    true = _scaled(case, seen, run.states[first : first + WINDOW])
    return true - plain, np.stack(shared, axis=1), np.stack(own, axis=1)


def read(
    case: Case, rig: Rig, drift: float, command: Array, y: Array, first: int, count: int, late: float = 0.0
) -> tuple[Array, Array]:
    """What a rig's position sensor says from `first` on by its clock, and the states by the table's.

    Args:
        case: whose controller it is.
        rig: that moves.
        drift: of the sensor's clock, as a share.
        command: V, of the whole recording.
        y: state at `first`.
        first, count: samples.
        late: by how many samples more it reads.

    Returns:
        Readings, m, NaN where the clock asks for what is not there, and states, (count, states).
    """
    at = (first + np.arange(count)) * (1.0 + drift) + late - first  # samples, as `recording` reads them
    last = min(first + max(count, math.ceil(at[-1]) + 1), len(command))
    states, clean = replay(rig, command / case.controller.limit, y, first, last - first, step=STEP)
    return np.interp(at, np.arange(len(clean)), clean, left=np.nan, right=np.nan), states[:count]


def moved(y: Array, by: dict[int, float]) -> Array:
    """A state with its position, speed or pressures changed, and what hangs on them; it slides as its speed says."""
    y = y.copy()
    for index, much in by.items():
        y[list(ALONG[index])] += much
    if y[V] != 0.0:
        y[WAY] = np.sign(y[V])
    return y


def _scaled_up(rig: Rig, name: str) -> Rig:
    return rig._replace(**{name: 1.02 * getattr(rig, name)})


def _scaled(case: Case, clean: Array, states: Array) -> Array:
    """The measured channels in standard deviations, one after the other."""
    s = case.sensors
    channels = [clean / np.hypot(s.position_noise, s.quantum / np.sqrt(12.0))]
    if case.with_pressures:
        channels += [states[:, PA] / s.pressure_noise, states[:, PB] / s.pressure_noise]
    return np.nan_to_num(np.concatenate(channels))  # what no clock reads shows nothing


def traces(recorded: Recorded) -> tuple[Trace | None, list[Trace]]:
    """Of everything that is concealed together, and of each effect given the others."""
    case = recorded.case
    if not case.hidden:
        return None, []
    each = [trace(recorded, without_one(case, effect)) for effect in case.hidden]
    return (each[0] if len(each) == 1 else trace(recorded, replace(case, hidden=()))), each


def without_one(case: Case, effect: Hidden) -> Case:
    """The case without one of its effects."""
    return replace(case, hidden=tuple(other for other in case.hidden if other is not effect))


def loop_shows(recorded: Recorded) -> float:
    """By how much the RMS tracking error differs from that of the rig with nothing missing, as a share."""
    case, with_it, plain = recorded.case, 0.0, 0.0
    for number, name in enumerate(TRAIN):
        run = recorded.runs[name]
        rng = np.random.default_rng([case.seed, number])
        reference = wanted(name, case, len(run.t) * DT, rng)
        other = simulate(
            case.plain, reference, rng, controller=case.controller, sensors=case.sensors, step=STEP
        )
        with_it += float(np.sum((run.reference - run.position) ** 2))
        plain += float(np.sum((other.reference - other.position) ** 2))
    return float(np.sqrt(with_it / plain) - 1.0)


def hidden_by(case: Case, found: Trace, active: float, tracking: float) -> list[str]:
    """What conceals an effect from the eye; "open" if nothing does.

    Args:
        case: that it is in.
        found: its trace.
        active: share of the time in which it acts.
        tracking: what `loop_shows` gave.
    """
    if found.left < UNSEEN:
        return ["unseen"]
    ways = {
        "noise": found.rise < FAINT,
        "refit": found.absorbed > MOST,
        "loop": abs(tracking) < SAME,
        "quantised": case.sensors.quantum > 0.0,
        "seldom": active < SELDOM,
    }
    return [way for way, holds in ways.items() if holds] or ["open"]


def acts_when(case: Case, run: Run, effect: Hidden) -> list[tuple[float, float]]:
    """Intervals (s) in which an effect's contribution exceeds a tenth of its largest."""
    share, without = run.command / case.controller.limit, without_one(case, effect).rig
    if without == case.rig:  # it acts on the clock, and so always
        return [(round(float(run.t[0]), 4), round(float(run.t[-1]), 4))]
    starts = range(0, len(run.t) - HORIZON - 1, STRIDE)
    strength = np.array([_contribution(case, without, share, run, first) for first in starts])
    top = np.quantile(strength, 0.99)
    on = strength > 0.1 * top if top > 0.0 else np.zeros(len(strength), dtype=bool)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], on.astype(int), [0]])))
    dt = float(run.t[1] - run.t[0]) * STRIDE
    return [(round(a * dt, 4), round(b * dt, 4)) for a, b in edges.reshape(-1, 2)]


def _contribution(case: Case, without: Rig, share: Array, run: Run, first: int) -> float:
    """Of an effect within a few samples: force, flow as force, and reading, each in comparable units."""
    y = run.states[first]
    (one, seen), (other, read) = (
        replay(rig, share, y, first, HORIZON + 1, step=STEP) for rig in (case.rig, without)
    )
    seconds = HORIZON * float(run.t[1] - run.t[0])
    off = one[-1] - other[-1]
    force = case.plain.mass * abs(off[V]) / seconds
    return float(force + AREA * (abs(off[PA]) + abs(off[PB])) + 1e5 * abs(seen[-1] - read[-1]))
