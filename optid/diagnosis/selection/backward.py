"""Backward elimination: effects that others make redundant are dropped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from optid.diagnosis.fitted import FittedModel, alternate_horizons, fit_model
from optid.diagnosis.problem import DiagnosisProblem, Stage
from optid.diagnosis.selection.path import SelectionPath
from optid.diagnosis.validation import Validated, cross_validate, rejection_reason
from optid.effects.effect import Effect
from optid.effects.library import admitted
from optid.rigs.rigfile import with_effects


def backward_elimination(path: SelectionPath, problem: DiagnosisProblem) -> SelectionPath:
    """Drop effects that would not be confirmed as the last one, the least needed first."""
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
            why = rejection_reason(size, path.first, errors, validated, problem.criteria, tried, alone)
            if why:
                idle.append((float(errors.windows.sum()), effect, why))
        if not idle:
            return replace(path, best=best, validated=validated, without=without, dropped=tuple(dropped))
        _, effect, why = min(idle, key=lambda one: one[0])
        dropped.append((effect, why))
        best, validated = without[effect.name]
    return replace(path, best=best, validated=validated, without={}, dropped=tuple(dropped))


def without_effect(model: FittedModel, effect: Effect, problem: DiagnosisProblem) -> FittedModel:
    """The model without one of its effects, fitted from the parameters of the one with it."""
    rest = tuple(one for one in model.effects if one is not effect)
    rig = with_effects(problem.rig, rest, {}) if rest else problem.rig
    q = problem.likelihood_problem(rig)
    p = q.model.vector({q.name: model.values[q.name] for q in q.model.parameters})
    return alternate_horizons(fit_model(problem, rest, rig, q, p), problem)


def without_effects(path: SelectionPath, names: Sequence[str], problem: DiagnosisProblem) -> SelectionPath:
    """The path to the rest of its effects, with the models that lack one more of them."""
    best, validated = path.best, path.validated
    for effect in path.best.effects:
        if effect.name in names:
            best = without_effect(best, effect, problem)
            validated = cross_validate(best, problem)
    without = {effect.name: _validated_without(path, best, effect, problem) for effect in best.effects}
    return replace(path, best=best, validated=validated, without=without)


def _validated_without(
    path: SelectionPath, model: FittedModel, effect: Effect, problem: DiagnosisProblem
) -> tuple[FittedModel, Validated]:
    """A model without one of its effects, with its errors; the base where nothing is left and it predicts better."""
    less = without_effect(model, effect, problem)
    errors = cross_validate(less, problem)
    better = less.effects or errors.windows.sum() <= path.first.windows.sum()
    return (less, errors) if better else (path.base, path.first)
