"""Search for a surrogate of a mismatch that no effect explains: forms at likely sites, judged as effects are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from optid.core.threads import parallel_map
from optid.diagnosis.fitted import FittedModel
from optid.diagnosis.localisation.unknown_input import UnknownInput, locate
from optid.diagnosis.problem import DiagnosisProblem, Stage, with_effect
from optid.diagnosis.proposals import Proposal, propose
from optid.diagnosis.selection.forward import begin_proposal, contend
from optid.diagnosis.selection.path import Contender, SelectionPath
from optid.diagnosis.surrogate.library import (
    curves,
    fitting,
    levels,
    shared,
    sticking,
    swelling,
    turned,
    waves,
)
from optid.diagnosis.surrogate.sinusoid import Linearisation
from optid.diagnosis.validation import Validated, flipped_signs
from optid.effects.description import Description
from optid.effects.effect import Effect
from optid.estimation.problem import cut_into, window_index


@dataclass(frozen=True, eq=False)
class Surrogate:
    """A form that describes a mismatch, as a contender, and the unknown inputs that locate the mismatch.

    Attributes:
        contender: the fitted form; ``None`` if none predicts better.
        sites: unknown inputs, the best first; `likely` are those of about the same quality.
    """

    contender: Contender | None
    sites: tuple[UnknownInput, ...]
    likely: tuple[UnknownInput, ...]

    def at(self, site: str) -> UnknownInput:
        """The unknown input at a site; the best one where none was tried there."""
        there = [one for one in self.sites if site in one.sites]
        return there[0].only(site) if there else self.sites[0]


def answer_of(path: SelectionPath, surrogate: Surrogate | None) -> FittedModel:
    """The model with named effects if they suffice, else the surrogate if it predicts better, or the base model."""
    if surrogate is None:
        return path.best
    described = surrogate.contender
    if described is not None and described.validated.windows.sum() < path.validated.windows.sum():
        return described.model
    return path.best


def localise(path: SelectionPath, problem: DiagnosisProblem) -> Surrogate | None:
    """Where a mismatch lies, without a form for it; ``None`` where no unknown input would be visible."""
    sites = locate(path.base, problem)
    return Surrogate(None, tuple(sites), (sites[0], *_rivalling(sites, problem))) if sites else None


def find_surrogate(
    path: SelectionPath, sites: Sequence[UnknownInput], problem: DiagnosisProblem
) -> Surrogate:
    """The form at the likely sites that predicts best; one alone, then in proportion to another signal.

    Args:
        path: of the selection; its base model lacks something.
        sites: unknown inputs, the best first.
        problem: the recordings.
    """
    base, first = path.base, path.first
    likely = (sites[0], *_rivalling(sites, problem))
    problem.report(Stage.SURROGATE, "describing the mismatch")
    forms = _forms(base, likely, problem.options.contenders)
    led = propose(base, forms, problem).ranked
    tried = len(forms)
    best = _best(base, first, led, problem, tried)
    if not _at_noise(best, problem):
        wave = _best(base, first, _waves(base, likely[:1], problem), problem, tried)
        best = min((one for one in (best, wave) if one is not None), key=_loss, default=None)
    if best is not None and not _at_noise(best, problem):
        more = fitting(base.rig, _variants(base, best.effect))
        led = propose(base, more, problem).ranked if more else ()
        other = _best(base, first, led, problem, tried + len(more))
        best = min((one for one in (best, other) if one is not None), key=_loss)
    return Surrogate(best, tuple(sites), likely)


def _at_noise(one: Contender | None, problem: DiagnosisProblem) -> bool:
    return one is not None and one.validated.error_over_noise <= problem.criteria.error_over_noise


def _loss(one: Contender) -> float:
    return float(one.validated.windows.sum())


def _forms(base: FittedModel, likely: Sequence[UnknownInput], most: int) -> list[Description]:
    """Forms at these sites, of each at `most` so many curves."""
    found: dict[str, Description] = {}
    for one in likely:
        for site in one.sites:
            found |= {form.name: form for form in curves(base, one.only(site))[:most]}
        found |= {form.name: form for form in sticking(base, one.sites)}
    found |= {form.name: form for form in shared(base, likely[0])}
    found |= {form.name: form for form in levels(base)}
    return fitting(base.rig, found.values())


def _variants(base: FittedModel, form: Effect) -> list[Description]:
    """The same in proportion to another signal, or drawn over that."""
    if not isinstance(form, Description):
        return []
    return [*swelling(base, form), *turned(base, form)]


def _waves(base: FittedModel, likely: Sequence[UnknownInput], problem: DiagnosisProblem) -> list[Proposal]:
    """The strongest sinusoid at each likely site, as the start of a search."""
    at, found = Linearisation.of(base, problem), []
    sites = dict.fromkeys(site for one in likely for site in one.sites)
    heard = [one for site in sites if not problem.budget.is_over for one in waves(at, site)]
    for wave, values, _ in sorted(heard, key=lambda one: -one[2])[:1]:
        q = problem.likelihood_problem(with_effect(base.rig, wave))
        p = q.at({**base.values, **wave.qualified(values)})
        found.append(Proposal(wave, q, p, math.inf))
    return found


def _best(
    base: FittedModel, first: Validated, led: Sequence[Proposal], problem: DiagnosisProblem, tried: int
) -> Contender | None:
    """The form with the smallest loss after one iteration that is confirmed; the others are not fitted fully."""
    led = led[: problem.options.contenders]
    begun = parallel_map(partial(begin_proposal, base, problem), led)
    ranked = [(fit, one) for fit, one in zip(begun, led, strict=True) if fit is not None]
    for fit, one in sorted(ranked, key=lambda pair: pair[0].loss):
        found = contend(base, first, first, problem, tried, one, fit)
        if found is not None and not found.why:
            return found
    return None


def _rivalling(sites: Sequence[UnknownInput], problem: DiagnosisProblem) -> list[UnknownInput]:
    """Those that the recordings do not distinguish from the first, at most two.

    Their likelihood ratio is less than the level asks of a test, or windows' signs may be chance.
    """
    best, level = sites[0], problem.criteria.level
    return [
        one
        for one in sites[1:]
        if best.gain - one.gain < -2.0 * math.log(level)
        or flipped_signs(_by_window(one, problem) - _by_window(best, problem)) > level
    ][:2]


def _by_window(one: UnknownInput, problem: DiagnosisProblem) -> np.ndarray:
    """-2 log likelihood of each window."""
    cut = cut_into(problem.likelihood_problem(problem.rig).problem, problem.window)
    return np.bincount(window_index(cut), weights=one.deviance)
