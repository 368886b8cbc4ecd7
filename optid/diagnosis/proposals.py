"""Which effects could it be: every branch of every effect by one simulation, then a race by multi-step errors.

A linear step chooses a branch of each effect (`optid.diagnosis.score_test`), and a simulation says how much of what it
promises holds. The best race on by Gauss-Newton steps, under gains of their own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np

from optid.core.llvm_simd import LANES
from optid.core.model import Array
from optid.core.threads import parallel_map
from optid.diagnosis.fitted import FittedModel
from optid.diagnosis.problem import DiagnosisProblem
from optid.diagnosis.score_test import LinearStep, Origin, branches_of, origin_at
from optid.effects.effect import Effect
from optid.errors import SolveError
from optid.estimation.fixed_gain import fixed_gain_fit, innovations
from optid.estimation.likelihood import huber
from optid.estimation.likelihood_point import LikelihoodProblem
from optid.estimation.multistep import QUIET, quiet_filter, window_starts
from optid.estimation.problem import Booleans

SHARES = np.linspace(0.0, 1.0, LANES)  # of a linear step, that are tried at once
SHORT = 5000  # samples of all recordings up to which a look at the catalogue takes them all


@dataclass(frozen=True, eq=False)
class Proposal:
    """An effect where a search has it.

    Attributes:
        effect: to come to the model.
        likelihood_problem: of the model with it.
        start: all parameters where a linear step had them; under gains of its own a race may lead them astray.
        p: all parameters where the race ended.
        loss: Huber's, of windows' errors.
    """

    effect: Effect
    likelihood_problem: LikelihoodProblem
    start: Array
    p: Array
    loss: float


@dataclass(frozen=True, eq=False)
class Proposals:
    """What a look at the catalogue found.

    Attributes:
        ranked: the most promising first, each effect once.
        visible: sd by which windows' errors would change, after a refit, with an effect of the smallest size worth a
            name, each window counting once; by the effect's name; 0 where nothing would change.
        alone: loss of the model without any of them, after as many steps over the same windows.
    """

    ranked: tuple[Proposal, ...]
    visible: Mapping[str, float]
    alone: float


Tried = TypeVar("Tried", Proposal, LinearStep)


def propose(
    current: FittedModel,
    effects: Sequence[Effect],
    problem: DiagnosisProblem,
    entrants: int | None = None,
    level: float = QUIET,
    begin: Array | None = None,
) -> Proposals:
    """Effects, the most promising first.

    Args:
        current: the model that they come to.
        effects: to try.
        problem: the recordings.
        entrants: branches at most that race; all if absent. Far from the truth a linear step holds for
            none, and a right law may stand in the middle.
        level: of process noise of the filters under whose gains they race.
        begin: parameters of the model from which branches begin; its own fitted ones if absent.
    """
    o, q = problem.options, current.likelihood_problem
    p = current.p if begin is None else begin
    first = worst_recordings(current, problem)
    resets = window_starts(q.problem, o.short * problem.window)
    per_window = max(o.short * problem.window / float(np.median(q.problem.dt)), 1.0)
    origin = origin_at(q, p, first, resets, per_window, level)
    if origin is None:
        return Proposals((), dict.fromkeys((effect.name for effect in effects), 0.0), math.inf)
    branches = parallel_map(partial(branches_of, current, problem, origin, first, resets), effects)
    visible = {
        effect.name: max((one.visible for one in some), default=0.0)
        for effect, some in zip(effects, branches, strict=True)
    }
    steps = [one.best for some in branches for one in some if one.best is not None]
    steps = keep_best(steps, len(steps))
    running = parallel_map(partial(_tried, origin, current, first, resets), steps)
    running = keep_best(running, entrants or len(running))
    for leg, (turns, most) in enumerate(o.race):
        if problem.budget.is_over:
            break
        over = first if leg < len(o.race) - 1 else None
        advanced = parallel_map(partial(_advance, problem, turns, over, resets, level), running)
        # The first is kept in any case: under its own gains a law may need more steps than a leg has.
        running = [*advanced[:1], *keep_best(advanced[1:], most - 1)]
    _, alone = _moved(problem, q, p, sum(turns for turns, _ in o.race), None, resets, level)
    return Proposals(tuple(keep_best(running, len(running))), visible, alone)


def keep_best(running: Sequence[Tried], most: int) -> list[Tried]:
    """Those that leave least, each effect once."""
    kept: list[Tried] = []
    for one in sorted(running, key=lambda one: one.loss):
        if len(kept) < most and math.isfinite(one.loss) and all(k.effect is not one.effect for k in kept):
            kept.append(one)
    return kept


def worst_recordings(current: FittedModel, problem: DiagnosisProblem) -> list[int]:
    """The segments of the recording in which most is missing, and of all others where these are short.

    What differs from recording to recording, as friction does under another pressure, shows in no single one: there the
    rig's own parameters make up for it.
    """
    q = current.likelihood_problem
    if len(q.problem.time) <= SHORT:
        return list(range(len(q.problem.counts)))
    return worst_recording(current, problem)


def worst_recording(current: FittedModel, problem: DiagnosisProblem) -> list[int]:
    """The segments of the recording in which most is missing."""
    q = current.likelihood_problem
    resets = window_starts(q.problem, problem.window)
    (z,) = innovations(q, current.p[None], q.model, current.fit.filtered, resets=resets)
    rows = np.nonzero(np.isfinite(current.fit.filtered.innovations[0]))[0]
    owner = np.repeat(q.problem.recording, q.problem.counts + 1)[rows]
    loss = np.bincount(owner, weights=huber(z))
    return np.flatnonzero(q.problem.recording == int(np.argmax(loss))).tolist()


def _tried(
    origin: Origin, current: FittedModel, only: Sequence[int], resets: Booleans, one: LinearStep
) -> Proposal:
    """A branch with the parameters moved, by as much of what a linear step promises as one simulation confirms."""
    q, steps = one.likelihood_problem, one.step * origin.typical
    moves = [
        {name: origin.values[name] + share * by for name, by in zip(origin.free, steps, strict=True)}
        for share in SHARES
    ]
    own = {each.name: float(one.p[i]) for i, each in enumerate(q.model.parameters)}
    P = np.array([q.at({**own, **move}) for move in moves])
    seen = innovations(q, P, current.likelihood_problem.model, origin.held, only, resets)
    losses = 0.5 * huber(seen).sum(axis=1)
    best = int(np.argmin(losses))
    return Proposal(one.effect, q, P[best], P[best], float(losses[best]))


def _advance(
    problem: DiagnosisProblem,
    steps: int,
    only: Sequence[int] | None,
    resets: Booleans,
    level: float,
    one: Proposal,
) -> Proposal:
    """The same some steps further; lost where the simulation diverges."""
    p, loss = _moved(problem, one.likelihood_problem, one.p, steps, only, resets, level)
    return replace(one, p=p, loss=loss)


def _moved(
    problem: DiagnosisProblem,
    q: LikelihoodProblem,
    p: Array,
    steps: int,
    only: Sequence[int] | None,
    resets: Booleans,
    level: float,
) -> tuple[Array, float]:
    """Parameters some Gauss-Newton steps further under gains of their own, and the loss there."""
    held = None if problem.budget.is_over else quiet_filter(q, p, only, level)
    if held is None:
        return p, math.inf
    try:
        fit = fixed_gain_fit(q, p, q.model, held, steps, only, resets)
    except SolveError:
        return p, math.inf
    return fit.p, fit.loss
