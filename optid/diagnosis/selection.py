"""Stepwise selection of effects, forward and backward, judged on windows that were not fitted."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from optid.core.model import Array
from optid.core.threads import parallel_map
from optid.diagnosis.fitted import FittedModel, fit_model
from optid.diagnosis.problem import DiagnosisProblem, Stage
from optid.diagnosis.proposals import Proposal, Proposals, propose
from optid.diagnosis.validation import Validated, cross_validate, rejection_reason
from optid.effects.effect import Effect
from optid.effects.library import admitted
from optid.errors import SolveError
from optid.estimation.multistep import QUIET, MultistepFit, fit_multistep
from optid.rigs.rigfile import with_effects

RESTART = 0.95  # of windows' errors: a model restarts from another point if at most this share remains there


@dataclass(frozen=True, eq=False)
class Contender:
    """A model with one more effect, and why it was rejected; "" if it is acceptable."""

    effect: Effect
    model: FittedModel
    validated: Validated
    why: str


@dataclass(frozen=True, eq=False)
class Round:
    """One step: its model, the proposals, those fully fitted, and the one selected."""

    model: FittedModel
    proposals: Proposals
    contenders: tuple[Contender, ...]
    taken: Contender | None


@dataclass(frozen=True, eq=False)
class SelectionPath:
    """The path of the selection.

    Attributes:
        base, best: the original model, and the result of the selection.
        first, validated: their cross-validated errors.
        rounds: every step.
        without: effect name -> the best model without that effect, with its errors.
        dropped: (effect, why) of those made redundant by others.
        ended_early: the budget was used up before everything was tried.
    """

    base: FittedModel
    best: FittedModel
    first: Validated
    validated: Validated
    rounds: tuple[Round, ...]
    without: Mapping[str, tuple[FittedModel, Validated]] = field(default_factory=dict)
    dropped: tuple[tuple[Effect, str], ...] = ()
    ended_early: bool = False

    @property
    def nearest(self) -> Contender | None:
        """The best contender, selected or not."""
        every = [one for step in self.rounds for one in step.contenders]
        return min(every, key=lambda one: one.validated.windows.sum(), default=None)

    @property
    def strongest(self) -> FittedModel | None:
        """The model of the best contender."""
        return None if self.nearest is None else self.nearest.model


def nothing_selected(base: FittedModel, problem: DiagnosisProblem) -> SelectionPath:
    """A path without steps."""
    first = cross_validate(base, problem)
    return SelectionPath(base, base, first, first, ())


def without_each(path: SelectionPath, answer: FittedModel) -> dict[str, FittedModel]:
    """The answer without each of its effects, by their names; the base for one that is not in the path."""
    if answer is path.best:
        return {name: model for name, (model, _) in path.without.items()}
    return {effect.name: path.base for effect in answer.effects}


def select(base: FittedModel, problem: DiagnosisProblem) -> SelectionPath:
    """Add effects while windows that were not fitted confirm them, and drop those that become redundant."""
    first = cross_validate(base, problem)
    current, validated, rounds = base, first, []
    for depth in range(problem.criteria.most_effects):
        if problem.budget.is_over:
            break
        problem.report(Stage.SELECTION, f"round {depth + 1}: ranking the effects")
        one = _round(current, first, validated, problem)
        if not depth:
            one = _restarted_from_stated_values(one, validated, problem)
        rounds.append(one)
        better = None if one.taken else _restarted(current, validated, one, problem)
        if better is not None:
            current, validated = better
            if not depth:
                base, first = current, validated
            if validated.error_over_noise <= problem.criteria.error_over_noise:
                break
            one = _round(current, first, validated, problem)
            rounds.append(one)
        if one.taken is None:
            break
        current, validated = one.taken.model, one.taken.validated
    path = SelectionPath(base, current, first, validated, tuple(rounds), ended_early=problem.budget.is_over)
    path = _backward(path, problem)
    return _first_swapped(path, problem) if _first_is_open(path, problem) else path


def _first_is_open(path: SelectionPath, problem: DiagnosisProblem) -> bool:
    """Whether the first of several effects was chosen while others were missing, and some mismatch remains."""
    if len(path.best.effects) < 2 or problem.budget.is_over:
        return False
    first = next(one.taken for one in path.rounds if one.taken is not None)
    most = problem.criteria.error_over_noise
    return min(first.validated.error_over_noise, path.validated.error_over_noise) > most


def _restarted(
    current: FittedModel, before: Validated, one: Round, problem: DiagnosisProblem
) -> tuple[FittedModel, Validated] | None:
    """The current model restarted from its best contender's parameters, if it predicts better from there.

    An absent effect may lead a fit out of a local optimum; then the model without it gets there as well.
    """
    if not one.contenders:
        return None
    best = min(one.contenders, key=lambda c: float(c.validated.windows.sum()))
    if not best.validated.windows.sum() < RESTART * before.windows.sum():
        return None
    model = without_effect(best.model, best.effect, problem)
    validated = cross_validate(model, problem)
    return (model, validated) if validated.windows.sum() < RESTART * before.windows.sum() else None


def _restarted_from_stated_values(one: Round, before: Validated, problem: DiagnosisProblem) -> Round:
    """The first step, or another one from the rig file's values where it leaves a mismatch and that one leaves less.

    What is missing may have pulled the fitted parameters far from the truth, as a dead band does with friction.
    """
    left = before if one.taken is None else one.taken.validated
    if left.error_over_noise <= problem.criteria.error_over_noise or problem.budget.is_over:
        return one
    stated = one.model.likelihood_problem.model.vector(problem.rig.parameters)
    nearest = min((each.loss for each in one.proposals.ranked), default=math.inf)
    other = _round(one.model, before, before, problem, begin=stated, below=RESTART * nearest)
    return other if other.taken and other.taken.validated.windows.sum() < left.windows.sum() else one


def _round(
    current: FittedModel,
    first: Validated,
    before: Validated,
    problem: DiagnosisProblem,
    but: str = "",
    begin: Array | None = None,
    below: float = math.inf,
) -> Round:
    """A step from the current model, or of its proposals from other parameters, those with a loss `below` a bound."""
    effects = [one for one in admitted(current.rig.model, problem.own) if one.name != but]
    near = before.error_over_noise <= problem.criteria.error_over_noise
    # A linear step and the model's own quiet filter are reliable only for a model at the noise.
    entrants, level = (problem.options.entrants, current.fit.level) if near else (None, QUIET)
    proposals = propose(current, effects, problem, entrants, level, begin)
    few = worth_fitting(proposals, near, bool(current.effects), problem)
    few = [each for each in few if each.loss < below]
    problem.report(Stage.SELECTION, f"fitting {', '.join(one.effect.name for one in few)}")
    fitted = parallel_map(partial(contend, current, first, before, problem, len(effects)), few)
    contenders = sorted(
        (one for one in fitted if one is not None),
        key=lambda one: (bool(one.why), one.validated.windows.sum()),
    )
    taken = next((one for one in contenders if not one.why), None)
    return Round(current, proposals, tuple(contenders), taken)


def worth_fitting(found: Proposals, near: bool, named: bool, problem: DiagnosisProblem) -> list[Proposal]:
    """Proposals to fit fully, depending on whether the model is at the noise and already has an effect."""
    o, least = problem.options, min((one.loss for one in found.ranked), default=0.0)
    few = [one for one in found.ranked[: o.contenders] if one.loss <= o.near * least]
    if not near:
        return few
    # A loss is quadratic in the error: a candidate with half the smallest gain here does not reach it in a full fit. #
    # Without any effect the first is fitted anyway, as the test asks whether it gains anything.
    most = (1.0 - problem.criteria.smallest_gain) * found.alone
    return [one for k, one in enumerate(few) if one.loss <= most or (k == 0 and not named)]


def contend(
    current: FittedModel,
    first: Validated,
    before: Validated,
    problem: DiagnosisProblem,
    tried: int,
    one: Proposal,
    begun: MultistepFit | None = None,
) -> Contender | None:
    """A proposal fully fitted, from where it was `begun`, and validated; ``None`` where the simulation diverges."""
    model = fit_proposal(current, problem, one, begun)
    if model is None:
        return None
    with contextlib.suppress(SolveError):
        validated = cross_validate(model, problem)
        size = one.effect.size(model.own_values(one.effect))
        alone = not current.effects
        why = rejection_reason(one.effect, size, first, before, validated, problem.criteria, tried, alone)
        return Contender(one.effect, model, validated, why)
    return None


def fit_proposal(
    current: FittedModel, problem: DiagnosisProblem, one: Proposal, begun: MultistepFit | None = None
) -> FittedModel | None:
    """A proposal fully fitted, from where it was `begun`; ``None`` where the simulation diverges."""
    begun = begin_proposal(current, problem, one) if begun is None else begun
    if begun is None:
        return None
    effects, q = (*current.effects, one.effect), one.likelihood_problem
    return fit_model(problem, effects, q.rig, q, begun.p, begun=begun)


def begin_proposal(current: FittedModel, problem: DiagnosisProblem, one: Proposal) -> MultistepFit | None:
    """The start with the smallest loss, after one iteration; ``None`` where the simulation diverges from all."""
    q, fits = one.likelihood_problem, []
    for p in _starts(one):
        with contextlib.suppress(SolveError):
            steps, level = problem.options.steps, current.fit.level
            fits.append(fit_multistep(q, p, problem.window, turns=1, steps=steps, level=level, most=1))
    return min(fits, key=lambda each: each.loss, default=None)


def _starts(one: Proposal) -> list[Array]:
    return [one.p] if np.array_equal(one.p, one.start) else [one.p, one.start]


def without_effect(model: FittedModel, effect: Effect, problem: DiagnosisProblem) -> FittedModel:
    """The model without one of its effects, fitted from the parameters of the one with it."""
    rest = tuple(one for one in model.effects if one is not effect)
    rig = with_effects(problem.rig, rest, {}) if rest else problem.rig
    q = problem.likelihood_problem(rig)
    p = q.model.vector({q.name: model.values[q.name] for q in q.model.parameters})
    return fit_model(problem, rest, rig, q, p)


def without_effects(path: SelectionPath, names: Sequence[str], problem: DiagnosisProblem) -> SelectionPath:
    """The path to the rest of its effects, with the models that lack one more of them."""
    best, validated = path.best, path.validated
    for effect in path.best.effects:
        if effect.name in names:
            best = without_effect(best, effect, problem)
            validated = cross_validate(best, problem)
    without = {effect.name: _validated_without(path, best, effect, problem) for effect in best.effects}
    return _with(path, best, validated, without, path.dropped)


def _validated_without(
    path: SelectionPath, model: FittedModel, effect: Effect, problem: DiagnosisProblem
) -> tuple[FittedModel, Validated]:
    """A model without one of its effects, with its errors; the base where nothing is left and it predicts better."""
    less = without_effect(model, effect, problem)
    errors = cross_validate(less, problem)
    better = less.effects or errors.windows.sum() <= path.first.windows.sum()
    return (less, errors) if better else (path.base, path.first)


def _backward(path: SelectionPath, problem: DiagnosisProblem) -> SelectionPath:
    """Backward elimination: drop effects that would not be confirmed as the last one, the least needed first."""
    best, validated, dropped = path.best, path.validated, list(path.dropped)
    tried = len(admitted(problem.rig.model, problem.own))
    while best.effects:
        without, idle = {}, []
        for effect in best.effects:
            problem.report(Stage.BACKWARD, f"testing whether {effect.name} is needed")
            less, errors = _validated_without(path, best, effect, problem)
            without[effect.name] = (less, errors)
            size = effect.size(best.own_values(effect))
            alone = not less.effects
            why = rejection_reason(
                effect, size, path.first, errors, validated, problem.criteria, tried, alone
            )
            if why:
                idle.append((float(errors.windows.sum()), effect, why))
        if not idle:
            return _with(path, best, validated, without, dropped)
        _, effect, why = min(idle, key=lambda one: one[0])
        dropped.append((effect, why))
        best, validated = without[effect.name]
    return _with(path, best, validated, {}, dropped)


def _with(
    path: SelectionPath,
    best: FittedModel,
    validated: Validated,
    without: Mapping[str, tuple[FittedModel, Validated]],
    dropped: Sequence[tuple[Effect, str]],
) -> SelectionPath:
    return SelectionPath(
        path.base, best, path.first, validated, path.rounds, without, tuple(dropped), path.ended_early
    )


def _first_swapped(path: SelectionPath, problem: DiagnosisProblem) -> SelectionPath:
    """Compare the first effect with the catalogue again: it was chosen while it was alone."""
    name = path.best.effects[0].name
    less, errors = path.without[name]
    problem.report(Stage.BACKWARD, f"testing alternatives to {name}")
    one = _round(less, path.first, errors, problem, but=name)
    better = one.taken
    if better is None or not better.validated.windows.sum() < path.validated.windows.sum():
        return replace(path, rounds=(*path.rounds, replace(one, taken=None)))
    rounds = (*path.rounds, one)
    swapped = replace(path, best=better.model, validated=better.validated, rounds=rounds, without={})
    return _backward(swapped, problem)
