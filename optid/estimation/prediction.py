"""Prediction as the contract defines it: free run, and 0.5 s windows whose start is known from the past alone."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import stats

from optid.core.model import Array, Model
from optid.core.recording import Recording
from optid.core.simulation import simulate
from optid.errors import RecordingError, SolveError
from optid.estimation.initial_trajectory import COARSE, guess, measured_states
from optid.estimation.objective import objective_of
from optid.estimation.problem import Problem, build_problem
from optid.estimation.result import Score
from optid.estimation.smoother import Objective, Point, Terms, descend
from optid.rigs.rigfile import Rig

if TYPE_CHECKING:
    import pandas as pd

HORIZON = 0.5  # s, of a window
FEWEST = 50  # samples of it, where sampling is too slow for that many in HORIZON
MEMORY = 4  # windows of the past that are estimated anew; what lies before them is a Gaussian prior
LOOSER = (0.3, 0.03, 3e-3)  # shares of each state's size through which the process noise is annealed
STARTS = 64  # of a young estimate, evenly spread: a power of two
LIKELIEST = 3  # of them that are gone on from
PINNED = 0.1  # of a sensor's noise: how far the windows may move what it shows as a free run begins
PROCESS_NOISE = 3e-3  # per window as a share of each state's size, when no fit says better


@dataclass(frozen=True, eq=False)
class Prediction:
    """`frame`: time, then NAME, NAME_free_run, NAME_window per measured output; `scores`: kind -> role -> Score.

    Attributes:
        horizon: length of a window, s.
        begins: time of the free run's start, s, and the state estimated there, SI, for every stretch.
        notes: what the scores do not show: where a prediction is not finite, where nothing was predicted.
    """

    frame: pd.DataFrame
    scores: Mapping[str, Mapping[str, Score]]
    horizon: float
    begins: tuple[tuple[float, Mapping[str, float]], ...] = ()
    notes: tuple[str, ...] = ()


def window_seconds(interval: float) -> float:
    """Length of a window, s, of a recording with a sample every `interval` seconds."""
    return max(HORIZON, FEWEST * interval)


def predict(
    rig: Rig,
    recording: Recording,
    values: Mapping[str, float] | None = None,
    process_noise: Array | None = None,
) -> Prediction:
    """Predict a recording with fixed parameters.

    The free run starts at the first measured sample, from what is measured there; states that no output shows
    directly are estimated from the recording's first windows. It follows the command to the end. A window's start
    state is estimated from data before the window only (moving horizon), so the first one has no window prediction:
    NaN. Where the command is missing for long nothing is predicted, and behind such a stretch both begin anew.

    Args:
        rig: model and channels.
        recording: what to predict.
        values: SI parameters; the rig's own when absent.
        process_noise: sd per window and state, SI; from the fit where there is one.

    Raises:
        RecordingError: no stretch of it has both a command and a measured output.
    """
    import pandas as pd

    model = rig.model
    p = model.vector(dict(values) if values is not None else rig.parameters)
    length = window_seconds(recording.interval)
    problem = build_problem(model, [_from_first_measured(model, recording)], length)
    objective, _ = objective_of(rig, (), problem)
    q = PROCESS_NOISE * model.scales if process_noise is None else np.asarray(process_noise)
    free_run, windows, begins = _predict(objective, p, q)
    rows = np.searchsorted(recording.time, problem.time)
    frame: dict[str, Array] = {"time": recording.time}
    scores: dict[str, dict[str, Score]] = {"free_run": {}, "window": {}}
    notes = list[str]()
    if len(rows) < len(recording):
        notes.append(
            f"{len(recording) - len(rows)} samples without a command or before any measurement: not predicted"
        )
    for j, port in enumerate(model.outputs):
        if port.role not in recording:
            continue
        y = recording[port.role].values
        frame[port.role] = y
        for kind, predicted in (("free_run", free_run), ("window", windows)):
            whole = np.full(len(recording), np.nan)
            whole[rows] = np.where(np.isfinite(predicted[:, j]), predicted[:, j], np.nan)
            frame[f"{port.role}_{kind}"] = whole
            scores[kind][port.role] = Score.of(y, whole, port.unit)
        notes += _not_finite(port.role, problem, free_run[:, j], windows[:, j])
    return Prediction(pd.DataFrame(frame), scores, length, begins, tuple(notes))


def _from_first_measured(model: Model, recording: Recording) -> Recording:
    """The recording without what lies before its first measured sample."""
    measured = np.zeros(len(recording), dtype=bool)
    for port in model.outputs:
        if port.role in recording:
            measured |= np.isfinite(recording[port.role].values)
    first = int(measured.argmax())
    cut = recording.taken(np.arange(first, len(recording))) if 0 < first < len(recording) - 1 else recording
    if not measured.any() or not cut.segments():
        raise RecordingError(
            "no stretch of it has both a command and a measured output",
            where=recording.name,
            expected="at least two samples in a row",
        )
    return cut


def _not_finite(role: str, problem: Problem, free_run: Array, windows: Array) -> list[str]:
    """Where predictions leave the numbers; the first window of a stretch has none and is not meant."""
    notes = []
    lost = ~np.isfinite(free_run)
    if lost.any():
        at = problem.time[int(lost.argmax())]
        notes.append(
            f"the free run of {role} is not finite from {at:.6g} s on: its scores are of what comes before"
        )
    heads = np.r_[True, problem.closed[:-1]]
    begins, counts = problem.begins[~heads], problem.counts[~heads]
    failed = [
        int(b) for b, c in zip(begins, counts, strict=True) if not np.isfinite(windows[b : b + c]).all()
    ]
    if failed:
        notes.append(
            f"{len(failed)} of {len(begins)} windows of {role} are not finite, the first from "
            f"{problem.time[failed[0]]:.6g} s on: its scores are of the others"
        )
    return notes


def _predict(
    o: Objective, p: Array, q: Array
) -> tuple[Array, Array, tuple[tuple[float, Mapping[str, float]], ...]]:
    b = o.problem
    free_run, begun = np.full_like(b.measured, np.nan), []
    for offset, part, at in _stretches(o, p):
        total = int(part.problem.begins[-1] + part.problem.counts[-1])
        start = _first_state(part, at, q)
        run = simulate(o.model, p, start, part.problem.dt, part.problem.inputs)
        free_run[offset : offset + total + 1] = run.outputs[0]
        state = {one.name: float(x) for one, x in zip(o.model.states, start, strict=True)}
        begun.append((float(b.time[offset]), state))
    return free_run, predict_windows(o, p, q).outputs, tuple(begun)


@dataclass(frozen=True, eq=False)
class WindowPredictions:
    """Predictions over the windows of a problem.

    Attributes:
        outputs: (samples, outputs); NaN in the first window of a stretch, before which nothing was read.
        starts: states where each window begins, SI, (windows, states); NaN in the first of a stretch.
        covariances: of these, of a model that lacks nothing: with process noise, what is missing would count as
            uncertain; (windows, states, states).
    """

    outputs: Array
    starts: Array
    covariances: Array


def predict_windows(o: Objective, p: Array, q: Array) -> WindowPredictions:
    """Predictions over the windows of a problem, each from what was read before it.

    Args:
        o: windows and how outputs are weighted.
        p: parameters, (parameters,).
        q: process noise, sd per window and state, SI.
    """
    count, nx = len(o.problem.begins), len(o.model.states)
    found = WindowPredictions(
        np.full_like(o.problem.measured, np.nan),
        np.full((count, nx), np.nan),
        np.full((count, nx, nx), np.nan),
    )
    for offset, part, at in _stretches(o, p):
        head = int(np.searchsorted(o.problem.begins, offset))
        for w, start, covariance, outputs in _windows(part, at, q):
            begin, length = int(part.problem.begins[w]), int(part.problem.counts[w])
            keep = length + 1 if w == len(part.problem.begins) - 1 else length
            found.outputs[offset + begin : offset + begin + keep] = outputs[:keep]
            found.starts[head + w], found.covariances[head + w] = start, covariance
    return found


def _stretches(o: Objective, p: Array) -> Iterator[tuple[int, Objective, Point]]:
    """Stretches between which nothing is carried: first sample, windows, and a guess of the states at their starts."""
    heads = np.flatnonzero(o.heads)
    for head, stop in zip(heads, [*heads[1:], len(o.problem.begins)], strict=True):
        part = _segment(o, int(head), int(stop))
        guessed = guess(part.model, part.problem, p)
        yield int(o.problem.begins[head]), part, Point(np.where(np.isfinite(guessed), guessed, o.start), p)


def _segment(o: Objective, head: int, stop: int) -> Objective:
    """Windows head..stop-1 as a problem of their own."""
    b = o.problem
    first, last = int(b.begins[head]), int(b.begins[stop - 1] + b.counts[stop - 1]) + 1
    rows, pick = slice(first, last), slice(head, stop)
    part = Problem(
        b.time[rows],
        np.ascontiguousarray(b.dt[rows]),
        np.ascontiguousarray(b.inputs[rows]),
        np.ascontiguousarray(b.measured[rows]),
        b.begins[pick] - first,
        b.counts[pick],
        b.closed[pick],
        b.linked[pick],
        b.recording[pick],
    )
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
    """Where the free run starts: what is measured as it is measured there, the rest from the first windows.

    A start that the windows may move trades an error at the beginning for errors of the model later on.
    """
    stop = min(MEMORY, len(o.problem.begins))
    mean, spread = o.start.copy(), o.spread.copy()
    direct = {i: j for i, j in measured_states(o.model)[0].items() if np.isfinite(o.problem.measured[0, j])}
    pinned = list(direct)
    mean[pinned] = at.X[0, pinned]
    spread[pinned] = [_pin(o, j, float(spread[i])) for i, j in direct.items()]
    past = _past(o, 0, stop, mean, spread)
    try:
        found = np.array(_best(past, Point(at.X[:stop], at.p), q)[0].X[0])
    except SolveError:  # the model leaves the numbers within the first windows
        found = np.array(at.X[0])
    found[pinned] = mean[pinned]
    return found


def _pin(o: Objective, output: int, spread: float) -> float:
    """Sd of a measured state at the start: a small part of the sensor's noise."""
    weight = float(o.weight[0, output])
    return min(PINNED / weight, spread) if weight > 0 else spread


def _best(o: Objective, at: Point, q: Array) -> tuple[Point, Terms]:
    """The likeliest estimate, of those from the guess and from the likeliest of many starts.

    An axis that sticks in the model and moves on the rig leaves no slope to follow, and two pairs of pressures that
    nothing shows may suit a first window.
    """
    found = []
    for near in (at, *_likeliest(o, at)):
        with contextlib.suppress(SolveError):
            found.append(_annealed(o, near, q))
    if not found:
        raise SolveError("the model leaves the numbers within the first windows")
    return min(found, key=lambda one: one[1].cost)


def _likeliest(o: Objective, at: Point) -> list[Point]:
    """The free runs that explain the data best, of starts spread over the states that no recorded output shows."""
    b = o.problem
    recorded = set(np.flatnonzero(np.isfinite(b.measured).any(axis=0)).tolist())
    shown = {i for states in measured_states(o.model) for i, j in states.items() if j in recorded}
    hidden = [i for i in range(len(o.spread)) if i not in shown]
    if not hidden:
        return []
    z = stats.norm.ppf(stats.qmc.Sobol(len(hidden), scramble=False).random(STARTS) + 0.5 / STARTS)
    starts = np.tile(at.X[0], (STARTS, 1))
    starts[:, hidden] = o.start[hidden] + o.spread[hidden] * z
    run = simulate(o.model, at.p, starts, b.dt, b.inputs, tolerance=COARSE)
    off = (run.outputs - b.measured[: run.outputs.shape[1]]) * o.weight[: run.outputs.shape[1]]
    lost = ~np.isfinite(run.outputs).all(axis=(1, 2))
    cost = np.where(lost, np.inf, np.nansum(off**2, axis=(1, 2)) + (z**2).sum(axis=1))
    return [Point(run.states[k, b.begins - b.begins[0]], at.p) for k in np.argsort(cost)[:LIKELIEST]]


def _annealed(o: Objective, at: Point, q: Array) -> tuple[Point, Terms]:
    """Loose to tight: started tight, a node that sticks keeps pressures the data would correct."""
    terms = None
    for looser in LOOSER:
        level = np.maximum(q, looser * o.model.scales)
        at, terms, _ = descend(o, at, level, precision=1e-4, terms=terms)
    return _tight(o, at, q, terms)


def _tight(o: Objective, at: Point, q: Array, terms: Terms | None = None) -> tuple[Point, Terms]:
    """From a start that is near: the window before carried most of it here."""
    at, terms, _ = descend(o, at, q, precision=1e-6, terms=terms)
    return at, terms


def _windows(o: Objective, at: Point, q: Array) -> Iterator[tuple[int, Array, Array, Array]]:
    """For every window after the first: its number, where it starts, how surely, and predicted outputs."""
    b = o.problem
    mean, spread, first = o.start, o.spread, 0
    covariance = np.diag(o.spread**2)
    X = at.X.copy()
    # Node states come from the guess, which looks at measurements around a node: the newest one is replaced by
    # what the model carries there, so that nothing of the window itself is used.
    for w in range(1, len(b.begins)):
        past = _past(o, first, w, mean, spread)
        try:
            near = Point(X[first:w], at.p)
            found, terms = _best(past, near, q) if first == 0 else _tight(past, near, q)
            X[first:w], X[w] = found.X, terms.end[-1]
            covariance = _carried(covariance, terms, o.model.scales)
            if w - first >= MEMORY:
                mean, spread = _arrival(past, found, terms, q)
                first += 1
        except SolveError:  # the model leaves the numbers: from here on anew
            mean, spread, first = X[w], o.spread, w
            covariance = np.diag(o.spread**2)
        run = simulate(
            o.model, at.p, X[w], b.dt, b.inputs, first=b.begins[w : w + 1], intervals=int(b.counts[w])
        )
        yield w, X[w].copy(), covariance, run.outputs[0]


def _carried(covariance: Array, terms: Terms, scales: Array) -> Array:
    """Covariance where the newest window ends, from that where it began and what was read in it."""
    nx = len(covariance)
    H, slope = terms.H[-1, :nx, :nx], terms.slope[-1, :, :nx]
    values, vectors = np.linalg.eigh(covariance / np.outer(scales, scales))
    root = scales[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    moved = slope @ root
    return np.asarray(moved @ np.linalg.solve(np.eye(nx) + root.T @ H @ root, moved.T))


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
