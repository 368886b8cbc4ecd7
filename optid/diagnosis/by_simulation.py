"""Judging by simulation from end to end: what few samples of a slow plant can tell, where something large is missing.

Process noise that is free takes over what is missing, and in few samples nothing speaks against it: effects that halve
a simulation's error gain a dozen in -2 log likelihood. A plant that forgets its start can be simulated through a whole
record instead (output error: Ljung, System Identification, 1999, section 4.2). Then there is no process noise, and what
the base model misses by counts as noise of the measurement, so that an effect must explain a share of it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from optid.core.simulation import simulate
from optid.diagnosis.candidate import Candidate, Data
from optid.diagnosis.judge import EXCESS, excess, judge
from optid.estimation.scoring import maximise
from optid.estimation.simplex import FEW

FORGOTTEN = 0.01  # share of a difference of the start that outputs may still show when a record ends


def by_simulation(base: Candidate, data: Data) -> tuple[Candidate, Data] | None:
    """The base model fitted by simulation, and the data to be judged so; ``None`` where likelihood serves better."""
    few = len(base.answer.question.problem.time) <= FEW
    if not few or excess(base.judged, data.noise) <= EXCESS or not forgets(base):
        return None
    plain, windows = base.rig.model, {role: score.rmse for role, score in base.judged.scores.items()}
    near = maximise(replace(data, misfit=windows).question(base.rig, plain), base.answer.p)
    # A simulation misses more than windows do, and where it begins it knows nothing: gains count the less for both.
    missed = near.filtered.innovations[0]
    whole = {
        port.role: float(np.sqrt(np.nanmean(missed[:, j] ** 2)))
        for j, port in enumerate(plain.outputs)
        if np.isfinite(missed[:, j]).any()
    }
    data = replace(data, misfit=whole)
    answer = maximise(data.question(base.rig, plain), near.p)
    return Candidate((), base.rig, answer, judge(answer, data.holdout)), data


def forgets(base: Candidate) -> bool:
    """Whether every record ends where it would have ended from another start, a usual size off in any state."""
    model, problem = base.rig.model, base.answer.question.problem
    for first, count in zip(problem.begins, problem.counts, strict=True):
        here = base.answer.filtered.states[0][first]
        starts = np.vstack([here, here + np.diag(model.scales)])
        firsts = np.full(len(starts), first)
        run = simulate(
            model, base.answer.p, starts, problem.dt, problem.inputs, first=firsts, intervals=int(count)
        )
        apart = np.abs(run.outputs[1:] - run.outputs[0])
        if not (apart[:, -1] <= FORGOTTEN * apart.max(axis=1)).all():
            return False
    return True
