"""Prediction as the contract defines it: free run, and 0.5 s windows whose start is known from the past alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from optid.core.model import Array
from optid.core.recording import Recording
from optid.core.simulation import simulate
from optid.errors import SolveError
from optid.estimation.objective import objective_of
from optid.estimation.problem import Problem, pose
from optid.estimation.result import Score
from optid.estimation.smoother import Objective, Point, Terms, descend
from optid.estimation.start import guess
from optid.rigs.rigfile import Rig

if TYPE_CHECKING:
    import pandas as pd

HORIZON = 0.5  # s, of a window
FEWEST = 50  # samples of it, where sampling is too slow for that many in HORIZON
MEMORY = 4  # windows of the past that are estimated anew; what lies before them is a Gaussian prior
LOOSER = (0.3, 0.03, 3e-3)  # shares of each state's size through which the process noise is annealed
SURPRISED = 2.0  # squared residuals a sample, in noise variances, above which a young estimate is tried from elsewhere
PROCESS_NOISE = 3e-3  # per window as a share of each state's size, when no fit says better


@dataclass(frozen=True, eq=False)
class Prediction:
    """`frame`: time, then NAME, NAME_free_run, NAME_window per measured output; `scores`: kind -> role -> Score.

    `horizon` is the length of a window, s.
    """

    frame: pd.DataFrame
    scores: Mapping[str, Mapping[str, Score]]
    horizon: float


def horizon(interval: float) -> float:
    """Length of a window, s, of a recording with a sample every `interval` seconds."""
    return max(HORIZON, FEWEST * interval)


def predict(
    rig: Rig,
    recording: Recording,
    values: Mapping[str, float] | None = None,
    process_noise: Array | None = None,
) -> Prediction:
    """Predict a recording with fixed parameters.

    The free run starts from the state that the recording's first window shows and follows the command to the
    end. A window's start state is estimated from data before the window only (moving horizon), so the first
    one has no window prediction: NaN.

    Args:
        rig: model and channels.
        recording: what to predict.
        values: SI parameters; the rig's own when absent.
        process_noise: sd per window and state, SI; from the fit where there is one.

    Raises:
        SolveError: the simulation leaves the numbers.
    """
    import pandas as pd

    model = rig.model
    p = model.vector(dict(values) if values is not None else rig.parameters)
    length = horizon(recording.interval)
    problem = pose(model, [recording], length)
    objective, _ = objective_of(rig, (), problem)
    q = PROCESS_NOISE * model.scales if process_noise is None else np.asarray(process_noise)
    free_run, windows = _predict(objective, p, q)
    frame: dict[str, Array] = {"time": problem.time}
    scores: dict[str, dict[str, Score]] = {"free_run": {}, "window": {}}
    for j, port in enumerate(model.outputs):
        y = problem.measured[:, j]
        if port.role not in recording:
            continue
        frame |= {port.role: y, f"{port.role}_free_run": free_run[:, j], f"{port.role}_window": windows[:, j]}
        scores["free_run"][port.role] = Score.of(y, free_run[:, j], port.unit)
        scores["window"][port.role] = Score.of(y, windows[:, j], port.unit)
    return Prediction(pd.DataFrame(frame), scores, length)


def _predict(o: Objective, p: Array, q: Array) -> tuple[Array, Array]:
    b = o.problem
    free_run, windows = np.full_like(b.measured, np.nan), np.full_like(b.measured, np.nan)
    heads = np.flatnonzero(o.heads)
    for head, stop in zip(heads, [*heads[1:], len(b.begins)], strict=True):
        part = _segment(o, int(head), int(stop))
        at = Point(guess(part.model, part.problem, p), p)
        offset = int(b.begins[head])
        total = int(part.problem.begins[-1] + part.problem.counts[-1])
        start = _first_state(part, at, q)
        run = simulate(o.model, p, start, part.problem.dt, part.problem.inputs)
        free_run[offset : offset + total + 1] = run.outputs[0]
        for w, begin, count, outputs in _windows(part, at, q):
            keep = count + 1 if w == len(part.problem.begins) - 1 else count
            windows[offset + begin : offset + begin + keep] = outputs[:keep]
    return free_run, windows


def _segment(o: Objective, head: int, stop: int) -> Objective:
    """Windows head..stop-1 as a problem of their own."""
    b = o.problem
    first, last = int(b.begins[head]), int(b.begins[stop - 1] + b.counts[stop - 1]) + 1
    rows, pick = slice(first, last), slice(head, stop)
    part = Problem(
        b.time[rows], np.ascontiguousarray(b.dt[rows]), np.ascontiguousarray(b.inputs[rows]),
        np.ascontiguousarray(b.measured[rows]), b.begins[pick] - first, b.counts[pick], b.closed[pick],
        b.linked[pick], b.recording[pick],
    )  # fmt: skip
    return replace(o, problem=part, weight=np.ascontiguousarray(o.weight[rows]))


def _past(o: Objective, first: int, stop: int, mean: Array, spread: Array) -> Objective:
    """Windows first..stop-1 up to, not including, the sample at which window `stop` begins."""
    b = o.problem
    part = _segment(o, first, stop)
    closed = np.zeros(stop - first, dtype=bool)
    linked = np.ones(stop - first, dtype=bool)
    linked[-1] = False
    assert len(b.begins) >= stop
    return replace(
        part, problem=replace(part.problem, closed=closed, linked=linked), start=mean, spread=spread
    )


def _first_state(o: Objective, at: Point, q: Array) -> Array:
    stop = min(MEMORY, len(o.problem.begins))
    past = _past(o, 0, stop, o.start, o.spread)
    return np.asarray(_best(past, Point(at.X[:stop], at.p), q)[0].X[0])


def _best(o: Objective, at: Point, q: Array) -> tuple[Point, Terms]:
    """The estimate, from further starts where the first one explains the data badly.

    An axis that sticks in the model and moves on the rig leaves no slope to follow: then each state in turn starts at
    either end of what is thought possible.
    """
    found, terms = _annealed(o, at, q)
    samples = int(np.isfinite(o.problem.measured).sum())
    for i in range(len(q)):
        for side in (1.0, -1.0):
            if terms.cost <= SURPRISED * samples:
                return found, terms
            X = at.X.copy()
            X[:, i] += side * o.spread[i]
            try:
                other, its = _annealed(o, Point(X, at.p), q)
            except SolveError:
                continue
            if its.cost < terms.cost:
                found, terms = other, its
    return found, terms


def _annealed(o: Objective, at: Point, q: Array) -> tuple[Point, Terms]:
    """Loose to tight: started tight, a node that sticks keeps pressures the data would correct."""
    terms = None
    for looser in LOOSER:
        level = np.maximum(q, looser * o.model.scales)
        at, terms, _ = descend(o, at, level, iterations=30, precision=1e-4, terms=terms)
    at, terms, _ = descend(o, at, q, iterations=30, precision=1e-6, terms=terms)
    return at, terms


def _windows(o: Objective, at: Point, q: Array) -> list[tuple[int, int, int, Array]]:
    """For every window after the first: its number, first sample, intervals and predicted outputs."""
    b, out = o.problem, []
    mean, spread, first = o.start, o.spread, 0
    X = at.X.copy()
    # Node states come from the guess, which looks at measurements around a node: the newest one is replaced by
    # what the model carries there, so that nothing of the window itself is used.
    for w in range(1, len(b.begins)):
        past = _past(o, first, w, mean, spread)
        try:
            estimate = _best if first == 0 else _annealed
            found, terms = estimate(past, Point(X[first:w], at.p), q)
            X[first:w], X[w] = found.X, terms.end[-1]
            if w - first >= MEMORY:
                mean, spread = _arrival(past, found, terms, q)
                first += 1
        except SolveError:  # the model leaves the numbers: from here on anew
            mean, spread, first = X[w], o.spread, w
        run = simulate(
            o.model, at.p, X[w], b.dt, b.inputs, first=b.begins[w : w + 1], intervals=int(b.counts[w])
        )
        out.append((w, int(b.begins[w]), int(b.counts[w]), run.outputs[0]))
    return out


def _arrival(past: Objective, found: Point, terms: Terms, q: Array) -> tuple[Array, Array]:
    """What the window that leaves the horizon says of the next node: mean and sd, with the process noise added."""
    nx = len(q)
    information = terms.H[0, :nx, :nx] + np.diag(1 / past.spread**2)
    D = past.model.scales
    inverse = np.linalg.inv(information * np.outer(D, D)) * np.outer(D, D)
    slope = terms.slope[0, :, :nx]
    move = inverse @ (terms.g[0, :nx] - (found.X[0] - past.start) / past.spread**2)
    spread = np.sqrt(np.diag(slope @ inverse @ slope.T) + q**2)
    return terms.end[0] + slope @ move, spread
