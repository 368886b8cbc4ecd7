"""Alternatives to a named effect: its look-alikes in its place, judged in the same way."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from optid.core.threads import parallel_map
from optid.diagnosis.fitted import FittedModel, alternate_horizons, fit_model
from optid.diagnosis.problem import DiagnosisProblem, Stage
from optid.diagnosis.proposals import Proposal, propose
from optid.diagnosis.selection.backward import without_effects
from optid.diagnosis.selection.path import Round, SelectionPath
from optid.diagnosis.validation import Validated, cross_validate, p_value
from optid.effects.anywhere import Anywhere
from optid.effects.effect import Effect
from optid.effects.library import admitted
from optid.errors import SolveError


@dataclass(frozen=True, eq=False)
class Alternative:
    """A model with a look-alike in place of an effect, and whether the windows distinguish the two."""

    effect: Effect
    model: FittedModel
    validated: Validated
    told_apart: bool


def are_confusable(one: Effect, other: Effect) -> bool:
    """Whether either lists the other as a look-alike."""
    return one.name in other.look_alikes or other.name in one.look_alikes


def compare_alternatives(
    path: SelectionPath, problem: DiagnosisProblem
) -> tuple[SelectionPath, Mapping[str, tuple[Alternative, ...]]]:
    """Compare every effect with its look-alikes in its place; one that predicts better replaces it."""
    found: dict[str, tuple[Alternative, ...]] = {}
    for effect in path.best.effects:
        problem.report(Stage.ALTERNATIVES, f"alternatives to {effect.name}")
        others = _others(path, effect, problem)
        better = min(others, key=lambda one: one.validated.windows.sum(), default=None)
        if better is not None and better.validated.windows.sum() < path.validated.windows.sum() - _price(
            better.effect, effect
        ):
            mine = Alternative(effect, path.best, path.validated, told_apart=False)
            others = [
                replace(one, told_apart=is_told_apart(one.validated, better.validated, problem))
                for one in (mine, *others)
                if one is not better
            ]
            path = _with_look_alike(path, effect, better, problem)
            effect = better.effect
        found[effect.name] = tuple(others)
    return path, found


def _with_look_alike(
    path: SelectionPath, effect: Effect, by: Alternative, problem: DiagnosisProblem
) -> SelectionPath:
    """The path to a look-alike in place of an effect; models that lack another effect have the look-alike, too."""
    path = replace(
        path, best=by.model, validated=by.validated, without={by.effect.name: path.without[effect.name]}
    )
    return without_effects(path, (), problem) if len(path.best.effects) > 1 else path


def _price(one: Effect, other: Effect) -> float:
    """Gain in the windows' log likelihood that additional parameters require, one each (Akaike).

    The site of a generic law counts as a parameter, because it may be put at any.
    """
    first, second = (len(each.fitted) + isinstance(each, Anywhere) for each in (one, other))
    return float(first - second)


def is_told_apart(worse: Validated, better: Validated, problem: DiagnosisProblem) -> bool:
    """Whether windows prefer the better of two models.

    A log likelihood ratio below 1 is no evidence (Kass and Raftery, J. Am. Statist. Assoc. 90, 1995): laws that are the
    same here differ by as much, because no fit ends exactly at its optimum.
    """
    at_noise = better.error_over_noise <= problem.criteria.error_over_noise
    p = p_value(worse.windows, better.windows, at_noise)
    return p <= problem.criteria.level and bool(worse.windows.sum() - better.windows.sum() >= 1.0)


def _others(path: SelectionPath, effect: Effect, problem: DiagnosisProblem) -> list[Alternative]:
    """Look-alikes together with the effects that stay: from rounds that tried the catalogue with just these, if any."""
    rest = {one.name for one in path.best.effects if one is not effect}
    rounds = [step for step in path.rounds if {one.name for one in step.model.effects} == rest]
    return _met(rounds, path, effect, problem) if rounds else _in_place(path, effect, problem)


def _met(
    rounds: Sequence[Round], path: SelectionPath, effect: Effect, problem: DiagnosisProblem
) -> list[Alternative]:
    """Look-alikes that were fully fitted when the effect was chosen: nothing else has changed since."""
    met = {
        one.effect.name: Alternative(
            one.effect, one.model, one.validated, is_told_apart(one.validated, path.validated, problem)
        )
        for step in rounds
        for one in step.contenders
        if not one.why and are_confusable(one.effect, effect) and one.effect is not effect
    }
    return list(met.values())


def _in_place(path: SelectionPath, effect: Effect, problem: DiagnosisProblem) -> list[Alternative]:
    less, _ = path.without[effect.name]
    kept = {one.name for one in path.best.effects}
    every = admitted(less.rig.model, problem.own)
    others = [one for one in every if are_confusable(one, effect) and one.name not in kept]
    if not others or problem.budget.is_over:
        return []
    # Start from the named model: the parameters of the one without it are biased by what it lacks.
    index = less.likelihood_problem.model.parameters
    stands = less.likelihood_problem.model.vector({q.name: path.best.values[q.name] for q in index})
    ranked = propose(less, [effect, *others], problem, begin=stands).ranked
    least = min((one.loss for one in ranked), default=0.0)
    near = [one for one in ranked if one.effect is not effect and one.loss <= problem.options.near * least]
    fitted = parallel_map(partial(_fitted, path, less.effects, problem), near)
    return [one for one in fitted if one is not None]


def _fitted(
    path: SelectionPath, rest: tuple[Effect, ...], problem: DiagnosisProblem, one: Proposal
) -> Alternative | None:
    with contextlib.suppress(SolveError):
        fitted = fit_model(
            problem, (*rest, one.effect), one.likelihood_problem.rig, one.likelihood_problem, one.p
        )
        model = alternate_horizons(fitted, problem)
        if one.effect.size(model.own_values(one.effect)) < 1.0:
            return None
        validated = cross_validate(model, problem)
        return Alternative(one.effect, model, validated, is_told_apart(validated, path.validated, problem))
    return None
