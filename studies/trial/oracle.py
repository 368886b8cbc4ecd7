"""The oracle: the true rig, told everything but the state, predicts the held-out recording in 0.5 s windows.

Each window's start is estimated from the second before it: one step of regularised least squares from the true
state, shortened where friction bends the path. That is where an estimator with the true model would end; what is
left is noise, and what noise does to the start.
"""

from __future__ import annotations

import numpy as np

from studies.independent_rig import Run
from studies.independent_rig.rig import Array
from studies.independent_rig.states import PA, PB, V, X
from studies.trial.case import Case
from studies.trial.concealment import NUDGES, WINDOW, moved, read
from studies.trial.record import HELD_OUT, Recorded

MEMORY = 1000  # samples before a window that tell its start
PRIOR = {X: 1e-3, V: 0.1, PA: 3e4, PB: 3e4}  # sd of what else may be known of the state then
SHARES = (1.0, 0.5, 0.2)  # of the step


def oracle_rmse(recorded: Recorded) -> float:
    """RMSE of the position over the windows after the first, m."""
    case, run = recorded.case, recorded.runs[HELD_OUT]
    measured = recorded.tables[HELD_OUT]["x"].to_numpy() / 1e3
    squares, count = 0.0, 0
    for begin in range(WINDOW, len(run.t), WINDOW):
        first, end = max(begin - MEMORY, 0), min(begin + WINDOW, len(run.t))
        start = _estimated(case, run, measured, first, begin)
        off = measured[begin:end] - _reading(case, run.command, start, first, end - first)[begin - first :]
        squares, count = squares + float(np.nansum(off**2)), count + int(np.isfinite(off).sum())
    return float(np.sqrt(squares / count))


def _estimated(case: Case, run: Run, measured: Array, first: int, begin: int) -> Array:
    """State at `first` as the readings from there up to `begin` tell it."""
    true, sd = run.states[first], case.sensors.position_noise
    scale = np.array(list(PRIOR.values()))

    def misfit(start: Array) -> Array:
        off = measured[first:begin] - _reading(case, run.command, start, first, begin - first)
        return np.where(np.isfinite(off), off, 0.0) / sd

    seen = misfit(true)
    J = (
        np.stack([(seen - misfit(moved(true, {k: much}))) / much for k, much in NUDGES.items()], axis=1)
        * scale
    )
    move = np.linalg.solve(J.T @ J + np.eye(len(scale)), J.T @ seen)
    best, least = true, float(seen @ seen)
    for share in SHARES:
        start = moved(true, dict(zip(NUDGES, share * scale * move, strict=True)))
        cost = float(np.sum(misfit(start) ** 2) + share**2 * move @ move)
        if cost < least:
            best, least = start, cost
    return best


def _reading(case: Case, command: Array, y: Array, first: int, count: int) -> Array:
    """What the sensor says from `first` on."""
    return read(case, case.rig, case.recorded_with.clock_drift, command, y, first, count)[0]
