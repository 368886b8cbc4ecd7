"""The oracle: the true rig, told everything but the state, predicts the held-out recording in 0.5 s windows.

Each window's start is estimated from the second before it and from what else may be known of the state then, which
errs as its spread says: one step of regularised least squares from the true state, of what the readings tell less
where friction bends the path. That is where an estimator with the true model would end; what is left is noise, and
what noise does to the start. Pressures of an axis at rest show in nothing, so that nobody can say when it breaks away:
what is known of them is drawn several times.
"""

from __future__ import annotations

import numpy as np

from studies.independent_rig import Run
from studies.independent_rig.rig import Array
from studies.independent_rig.states import PA, PB, V, X
from studies.trial.case import Case
from studies.trial.concealment import NUDGES, WINDOW, moved, read
from studies.trial.record import HELD_OUT, Recorded

DRAWS = 4  # of what else is known
MEMORY = 1000  # samples before a window that tell its start
PRIOR = {X: 1e-3, V: 0.1, PA: 3e4, PB: 3e4}  # sd of what else may be known of the state then
SHARES = (1.0, 0.5, 0.2, 0.0)  # of what the readings tell


def oracle_rmse(recorded: Recorded) -> float:
    """RMSE of the position over the windows after the first, m."""
    run, generator = recorded.runs[HELD_OUT], np.random.default_rng(0)
    measured = _measured(recorded)
    squares, count = 0.0, 0
    for begin in range(WINDOW, len(run.t), WINDOW):
        first, end = max(begin - MEMORY, 0), min(begin + WINDOW, len(run.t))
        draws = generator.standard_normal((DRAWS, len(PRIOR)))
        for start in _estimated(recorded.case, run, measured, first, begin, draws):
            read = _readings(recorded.case, run.command, start, first, end - first)[begin - first :]
            off = (measured[begin:end] - read)[:, 0]
            squares, count = squares + float(np.nansum(off**2)), count + int(np.isfinite(off).sum())
    return float(np.sqrt(squares / count))


def _estimated(case: Case, run: Run, measured: Array, first: int, begin: int, draws: Array) -> list[Array]:
    """States at `first` as the readings from there up to `begin` tell them, one for each of the `draws`.

    They are what else is known there, off by so many of PRIOR, (draws, PRIOR).
    """
    true, scale = run.states[first], np.array(list(PRIOR.values()))
    sd = np.array([case.sensors.position_noise, case.sensors.pressure_noise, case.sensors.pressure_noise])

    def misfit(start: Array) -> Array:
        off = measured[first:begin] - _readings(case, run.command, start, first, begin - first)
        return np.nan_to_num(off / sd[: off.shape[1]]).ravel()

    seen = misfit(true)
    J = (
        np.stack([(seen - misfit(moved(true, {k: much}))) / much for k, much in NUDGES.items()], axis=1)
        * scale
    )
    inverse, starts = np.linalg.inv(J.T @ J + np.eye(len(scale))), []
    for known in draws:
        best, least = true, float(seen @ seen + known @ known)
        for share in SHARES:
            move = inverse @ (known + share * (J.T @ seen))
            start = moved(true, dict(zip(NUDGES, scale * move, strict=True)))
            cost = float(np.sum(misfit(start) ** 2) + np.sum((move - known) ** 2))
            if cost < least:
                best, least = start, cost
        starts.append(best)
    return starts


def _measured(recorded: Recorded) -> Array:
    """What the sensors said in the recording held out, SI, (samples, channels): position, and pressures if any."""
    table = recorded.tables[HELD_OUT]
    columns = [table["x"] / 1e3]
    if recorded.case.with_pressures:
        columns += [table["pa"] * 1e5, table["pb"] * 1e5]
    return np.stack(columns, axis=1)


def _readings(case: Case, command: Array, y: Array, first: int, count: int) -> Array:
    """What the sensors say from `first` on, without noise, as in `_measured`."""
    clean, states = read(case, case.rig, case.recorded_with.clock_drift, command, y, first, count)
    pressures = states[:, [PA, PB]] if case.with_pressures else np.empty((count, 0))
    return np.column_stack([clean, pressures])
