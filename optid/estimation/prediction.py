"""Predictions: a free run, and windows whose start state is estimated from past data only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from optid.core.model import Array, Model
from optid.core.recording import Recording
from optid.core.simulation import simulate
from optid.errors import RecordingError, SolveError
from optid.estimation.initial_trajectory import measured_states
from optid.estimation.moving_horizon import MEMORY, best_estimate, past_of, predict_windows, stretches
from optid.estimation.objective import objective_of
from optid.estimation.problem import Problem, build_problem, window_seconds
from optid.estimation.result import Score
from optid.estimation.smoother import Objective, Point
from optid.rigs.rigfile import Rig

if TYPE_CHECKING:
    import pandas as pd

PINNED = 0.1  # of a sensor's noise: how far the first windows may correct the start of a free run
PROCESS_NOISE = 3e-3  # process noise per window, as a share of each state's size, without a fit's value


@dataclass(frozen=True, eq=False)
class Prediction:
    """`frame`: time, then NAME, NAME_free_run, NAME_window per measured output; `scores`: kind -> role -> Score.

    Attributes:
        horizon: length of a window, s.
        begins: time of the free run's start, s, and the state estimated there, SI, for every stretch.
        notes: what the scores do not show: where a prediction is not finite, or nothing was predicted.
    """

    frame: pd.DataFrame
    scores: Mapping[str, Mapping[str, Score]]
    horizon: float
    begins: tuple[tuple[float, Mapping[str, float]], ...] = ()
    notes: tuple[str, ...] = ()


def predict(
    rig: Rig,
    recording: Recording,
    values: Mapping[str, float] | None = None,
    process_noise: Array | None = None,
) -> Prediction:
    """Predict a recording with fixed parameters.

    The free run starts at the first measured sample, from the measurement there; unmeasured states are estimated from
    the recording's first windows. It uses the command up to the end. A window's start state is estimated from data
    before the window only (moving horizon), so the first one has no window prediction: NaN. Where the command is
    missing for long nothing is predicted, and after it both start again.

    Args:
        rig: model and channels.
        recording: to predict.
        values: SI parameters; the rig's own when absent.
        process_noise: sd per window and state, SI; from the fit where there is one.

    Raises:
        RecordingError: no part of the recording has both a command and a measured output.
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
            f"{len(recording) - len(rows)} samples have no command or precede the first measurement: they are not "
            "predicted"
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
            # What a free run that diverges shows until then is not its error.
            diverged = kind == "free_run" and not np.isfinite(predicted[:, j]).all()
            scores[kind][port.role] = Score.of(
                y, np.full_like(whole, np.nan) if diverged else whole, port.unit
            )
        notes += _not_finite(port.role, problem, free_run[:, j], windows[:, j])
    return Prediction(pd.DataFrame(frame), scores, length, begins, tuple(notes))


def _from_first_measured(model: Model, recording: Recording) -> Recording:
    """The recording from its first measured sample on."""
    measured = np.zeros(len(recording), dtype=bool)
    for port in model.outputs:
        if port.role in recording:
            measured |= np.isfinite(recording[port.role].values)
    first = int(measured.argmax())
    cut = recording.taken(np.arange(first, len(recording))) if 0 < first < len(recording) - 1 else recording
    if not measured.any() or not cut.segments():
        raise RecordingError(
            "no part of the recording has both a command and a measured output",
            where=recording.name,
            expected="at least two samples in a row",
        )
    return cut


def _not_finite(role: str, problem: Problem, free_run: Array, windows: Array) -> list[str]:
    """Where predictions are not finite; the first window of a stretch has none and does not count."""
    notes = []
    lost = ~np.isfinite(free_run)
    if lost.any():
        at = problem.time[int(lost.argmax())]
        notes.append(f"the free run of {role} is not finite from {at:.6g} s on: it has no score")
    heads = np.r_[True, problem.closed[:-1]]
    begins, counts = problem.begins[~heads], problem.counts[~heads]
    failed = [
        int(b) for b, c in zip(begins, counts, strict=True) if not np.isfinite(windows[b : b + c]).all()
    ]
    if failed:
        notes.append(
            f"{len(failed)} of {len(begins)} windows of {role} are not finite, the first from "
            f"{problem.time[failed[0]]:.6g} s on: its scores count only the others"
        )
    return notes


def _predict(
    o: Objective, p: Array, q: Array
) -> tuple[Array, Array, tuple[tuple[float, Mapping[str, float]], ...]]:
    b = o.problem
    free_run, begun = np.full_like(b.measured, np.nan), []
    for offset, part, at in stretches(o, p):
        total = int(part.problem.begins[-1] + part.problem.counts[-1])
        start = _first_state(part, at, q)
        run = simulate(o.model, p, start, part.problem.dt, part.problem.inputs)
        free_run[offset : offset + total + 1] = run.outputs[0]
        state = {one.name: float(x) for one, x in zip(o.model.states, start, strict=True)}
        begun.append((float(b.time[offset]), state))
    return free_run, predict_windows(o, p, q).outputs, tuple(begun)


def _first_state(o: Objective, at: Point, q: Array) -> Array:
    """Start state of the free run: measured states from the first sample, the others from the first windows.

    If the windows could move the start freely, they would trade an error there for the model's errors later on.
    """
    stop = min(MEMORY, len(o.problem.begins))
    mean, spread = o.start.copy(), o.spread.copy()
    direct = {i: j for i, j in measured_states(o.model)[0].items() if np.isfinite(o.problem.measured[0, j])}
    pinned = list(direct)
    mean[pinned] = at.X[0, pinned]
    spread[pinned] = [_pin(o, j, float(spread[i])) for i, j in direct.items()]
    past = past_of(o, 0, stop, mean, spread)
    try:
        found = np.array(best_estimate(past, Point(at.X[:stop], at.p), q)[0].X[0])
    except SolveError:  # the model diverges within the first windows
        found = np.array(at.X[0])
    found[pinned] = mean[pinned]
    return found


def _pin(o: Objective, output: int, spread: float) -> float:
    """Sd of a measured state at the start: a small part of the sensor's noise."""
    weight = float(o.weight[0, output])
    return min(PINNED / weight, spread) if weight > 0 else spread
