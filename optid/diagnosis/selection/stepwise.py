"""Stepwise selection of effects, forward and backward, judged on windows that were not fitted."""

from __future__ import annotations

import math

from optid.diagnosis.fitted import FittedModel
from optid.diagnosis.problem import DiagnosisProblem, Stage
from optid.diagnosis.selection.backward import backward_elimination, without_effect
from optid.diagnosis.selection.forward import forward_step
from optid.diagnosis.selection.path import Round, SelectionPath
from optid.diagnosis.validation import Validated, cross_validate


def select(base: FittedModel, problem: DiagnosisProblem, begun: FittedModel | None = None) -> SelectionPath:
    """Add effects while windows that were not fitted confirm them, and drop those that become redundant.

    Args:
        base: the model without effects.
        problem: the recordings.
        begun: a model with effects from which the search goes on; the base if absent.
    """
    first = cross_validate(base, problem)
    current = base if begun is None else begun
    validated, rounds = cross_validate(current, problem), []
    for depth in range(len(current.effects), problem.criteria.most_effects):
        if problem.budget.is_over:
            break
        problem.report(Stage.SELECTION, f"round {depth + 1}: ranking the effects")
        one = forward_step(current, first, validated, problem)
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
            one = forward_step(current, first, validated, problem)
            rounds.append(one)
        if one.taken is None:
            break
        current, validated = one.taken.model, one.taken.validated
    path = SelectionPath(base, current, first, validated, tuple(rounds), ended_early=problem.budget.is_over)
    return backward_elimination(path, problem)


def _largest_share_left(problem: DiagnosisProblem) -> float:
    """Share of the windows' errors that may remain from another start for it to be worth going on from."""
    return 1.0 - problem.criteria.smallest_gain


def _restarted(
    current: FittedModel, before: Validated, one: Round, problem: DiagnosisProblem
) -> tuple[FittedModel, Validated] | None:
    """The current model restarted from its best contender's parameters, if it predicts better from there.

    An absent effect may lead a fit out of a local optimum; then the model without it gets there as well.
    """
    if not one.contenders:
        return None
    best = min(one.contenders, key=lambda c: float(c.validated.windows.sum()))
    if not best.validated.windows.sum() < _largest_share_left(problem) * before.windows.sum():
        return None
    model = without_effect(best.model, best.effect, problem)
    validated = cross_validate(model, problem)
    return (
        (model, validated)
        if validated.windows.sum() < _largest_share_left(problem) * before.windows.sum()
        else None
    )


def _restarted_from_stated_values(one: Round, before: Validated, problem: DiagnosisProblem) -> Round:
    """The first step, or another one from the rig file's values where it leaves a mismatch and that one leaves less.

    What is missing may have pulled the fitted parameters far from the truth, as a dead band does with friction.
    """
    left = before if one.taken is None else one.taken.validated
    if left.error_over_noise <= problem.criteria.error_over_noise or problem.budget.is_over:
        return one
    stated = one.model.likelihood_problem.model.vector(problem.rig.parameters)
    nearest = min((each.loss for each in one.proposals.ranked), default=math.inf)
    other = forward_step(
        one.model, before, before, problem, begin=stated, below=_largest_share_left(problem) * nearest
    )
    return other if other.taken and other.taken.validated.windows.sum() < left.windows.sum() else one
