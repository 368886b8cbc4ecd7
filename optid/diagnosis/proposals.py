"""Proposals: every branch of every effect by one simulation, then the best of each by multi-step errors.

A linear step chooses a branch of each effect (`optid.diagnosis.score_test`). These go on by Gauss-Newton steps over
short windows, with the gains of their own filters, and the best contend for a place in the model.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from typing import TypeVar

import numpy as np

from optid.core.model import Array
from optid.core.threads import parallel_map
from optid.diagnosis.fitted import FittedModel
from optid.diagnosis.problem import DiagnosisProblem, with_effect
from optid.diagnosis.score_test import LinearStep, Origin, branches_of, linear_loss_without_effect, origin_at
from optid.effects.effect import Effect
from optid.errors import SolveError
from optid.estimation.fixed_gain import fixed_gain_fit
from optid.estimation.likelihood_point import LikelihoodProblem
from optid.estimation.multistep import QUIET, quiet_filter, window_starts
from optid.estimation.problem import Booleans

# Effects that are scored in one model where few will compete: a first call compiles for 12 processor s less of 78 than
# with one each, later calls take the same.
TOGETHER = 5


@dataclass(frozen=True, eq=False)
class Proposal:
    """A proposed effect with its parameters.

    Attributes:
        effect: to be added to the model.
        likelihood_problem: of the model with it.
        p: all parameters at the end of the iterations.
        loss: Huber's, of windows' errors.
    """

    effect: Effect
    likelihood_problem: LikelihoodProblem
    p: Array
    loss: float


@dataclass(frozen=True, eq=False)
class Proposals:
    """The proposals from the catalogue.

    Attributes:
        ranked: the most promising first, each effect once.
        visible: effect name -> change of windows' errors in sd, after a refit, by an effect of the smallest size worth
            a name, each window counting once; 0 where nothing would change.
        alone: loss of the model without any of them, after the same number of steps over the same windows.
    """

    ranked: tuple[Proposal, ...]
    visible: Mapping[str, float]
    alone: float


Tried = TypeVar("Tried", Proposal, LinearStep)


def propose(
    current: FittedModel,
    effects: Sequence[Effect],
    problem: DiagnosisProblem,
    promise: float | None = None,
    level: float = QUIET,
    begin: Array | None = None,
) -> Proposals:
    """Rank effects, the most promising first.

    Args:
        current: the model to which they are added.
        effects: to try.
        problem: the recordings.
        promise: share of the loss that the linear step of a branch must save, beyond what the model's own parameters
            save, for it to compete; all compete if absent. Far from the optimum linear steps are not reliable, and the
            right law may rank in the middle.
        level: of process noise of the filters that give their gains.
        begin: parameters of the model from which branches start; its fitted ones if absent.
    """
    o, q = problem.options, current.likelihood_problem
    p = current.p if begin is None else begin
    resets = window_starts(q.problem, o.short * problem.window)
    per_window = max(o.short * problem.window / float(np.median(q.problem.dt)), 1.0)
    origin = origin_at(q, p, resets, per_window, level)
    if origin is None:
        return Proposals((), dict.fromkeys((effect.name for effect in effects), 0.0), math.inf)
    # Where few will compete, most need no model of their own.
    size = TOGETHER if promise is not None else 1
    together = [effects[k : k + size] for k in range(0, len(effects), size)]
    found = parallel_map(partial(branches_of, current, problem, origin, resets), together)
    branches = dict(zip((effect.name for effect in effects), chain.from_iterable(found), strict=True))
    visible = {name: max((one.visible for one in some), default=0.0) for name, some in branches.items()}
    every = [one.best for some in branches.values() for one in some if one.best is not None]
    steps = keep_best(every, len(every))
    if promise is not None:
        most = (1.0 - promise) * linear_loss_without_effect(origin)
        # Without any effect the first competes anyway: the test asks whether it gains anything.
        steps = [one for k, one in enumerate(steps) if one.loss <= most or (k == 0 and not current.effects)]
    advance = partial(_proposal_after_steps, current, problem, origin, resets, level)
    advanced = parallel_map(advance, steps)
    if not advanced:
        return Proposals((), visible, math.inf)
    # A linear step may choose the wrong branch of the right effect, from which a fit does not return.
    nearest = [one.effect for one in keep_best(advanced, o.contenders)]
    advanced += parallel_map(advance, [one for one in every if one.effect in nearest and one not in steps])
    _, alone = _after_steps(problem, q, p, resets, level)
    return Proposals(tuple(keep_best(advanced, o.contenders)), visible, alone)


def keep_best(running: Sequence[Tried], most: int) -> list[Tried]:
    """Those with the smallest loss, each effect once."""
    kept: list[Tried] = []
    for one in sorted(running, key=lambda one: one.loss):
        if len(kept) < most and math.isfinite(one.loss) and all(k.effect is not one.effect for k in kept):
            kept.append(one)
    return kept


def _proposal_after_steps(
    current: FittedModel,
    problem: DiagnosisProblem,
    origin: Origin,
    resets: Booleans,
    level: float,
    one: LinearStep,
) -> Proposal:
    """A branch after some Gauss-Newton steps from the model's own parameters; lost where the simulation diverges."""
    q = problem.likelihood_problem(with_effect(current.rig, one.effect))
    start = q.at({**origin.values, **one.effect.qualified(one.values)})
    return Proposal(one.effect, q, *_after_steps(problem, q, start, resets, level))


def _after_steps(
    problem: DiagnosisProblem,
    q: LikelihoodProblem,
    p: Array,
    resets: Booleans,
    level: float,
) -> tuple[Array, float]:
    """Parameters after some Gauss-Newton steps with their own gains, and the loss there."""
    held = None if problem.budget.is_over else quiet_filter(q, p, level)
    if held is None:
        return p, math.inf
    try:
        fit = fixed_gain_fit(q, p, q.model, held, problem.options.proposal_steps, resets=resets)
    except SolveError:
        return p, math.inf
    return fit.p, fit.loss
