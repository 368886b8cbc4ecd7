"""Findings: what is missing, where and when it acts, and what it could be confused with."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from optid.core.model import Array
from optid.core.quantity import quantity
from optid.diagnosis.alternatives import Alternative
from optid.diagnosis.localisation.activity import effect_activity, share_of_largest
from optid.diagnosis.localisation.effect_signal import effect_signal_at
from optid.diagnosis.localisation.region import (
    Region,
    contribution,
    informative_ranges,
    region,
    running_rms,
)
from optid.diagnosis.localisation.unknown_input import UnknownInput, locate_at
from optid.diagnosis.problem import Stage
from optid.diagnosis.refinement import RefinedModel
from optid.diagnosis.result import Finding, Suspicion
from optid.diagnosis.surrogate.library import kind_of
from optid.diagnosis.surrogate.search import Surrogate
from optid.diagnosis.tested_result import TestedResult
from optid.diagnosis.testing import Evidence
from optid.effects.effect import Effect
from optid.estimation.result import Estimate

NOTHING = 0.01  # of the smallest size worth a name: smaller values are described in words


def named_findings(
    s: TestedResult, parameters: Sequence[Estimate], suspects: Sequence[Suspicion]
) -> tuple[Finding, ...]:
    """One finding for each proven effect, the strongest first, then one for what is suspected in addition."""
    doubts = {one.effect for one in suspects}
    found = [_named(s, effect, parameters) for effect in s.best.effects if effect.name not in doubts]
    return (*sorted(found, key=lambda f: -f.train_gain), *suspected_findings(s, suspects))


def own_estimates(effect: Effect, parameters: Sequence[Estimate]) -> tuple[Estimate, ...]:
    """An effect's parameters by own name."""
    prefix = f"{effect.name}."
    return tuple(
        replace(e, name=e.name.removeprefix(prefix)) for e in parameters if e.name.startswith(prefix)
    )


def _named(s: TestedResult, effect: Effect, parameters: Sequence[Estimate]) -> Finding:
    s.problem.report(Stage.VERDICT, f"where and when {effect.name} acts")
    where, best = _region_of(s, effect), s.best
    ranges = informative_ranges(where.states, tuple(n for n in effect.depends_on if n in where.states))
    own = own_estimates(effect, parameters)
    _, errors = s.path.without[effect.name]
    gain = float(errors.windows.sum() - s.path.validated.windows.sum())
    bic = 2.0 * gain - len(effect.fitted) * math.log(len(s.path.validated.windows))
    signal, law = _signal(s, effect)
    return Finding(
        effect=effect,
        site=effect.site,
        place=effect.sites[0],
        parameters=own,
        region=where,
        shown=tuple(ranges),
        evidence=s.test.names[effect.name],
        train_gain=gain,
        delta_bic=bic,
        indistinguishable=_indistinguishable(best, effect, s.alternatives),
        sentence=sentence(effect, best),
        signal=signal,
        law=law,
    )


def _region_of(s: TestedResult, effect: Effect) -> Region:
    """Where and when one effect of the best model acts."""
    best = s.best
    mismatch = contribution(best.fit, best.at_null(effect))
    plant = {q.name: float(best.fit.p[k]) for k, q in enumerate(best.rig.model.parameters)}
    within = effect.active_range(best.own_values(effect), plant)
    return region(best.fit, mismatch, effect_activity(best, effect), s.problem.train, within)


def _signal(s: TestedResult, effect: Effect) -> tuple[UnknownInput | None, Array | None]:
    """The unknown input at the effect's site and its law there, at the first site that the law changes."""
    for site in effect.sites:
        law = effect_signal_at(s.base, s.best, site)
        if law is not None and np.isfinite(law).all() and np.ptp(law) > 0.0:
            found = locate_at(s.path.base, s.search, site)
            return None if found is None else _at_all_samples(s, found), law
    return None, None


def _at_all_samples(s: TestedResult, found: UnknownInput) -> UnknownInput:
    """A signal found at the rate of the search, at every sample."""
    return found.at_samples_of(s.base.fit.likelihood_problem.problem, s.path.base.likelihood_problem.problem)


def _indistinguishable(
    best: RefinedModel, effect: Effect, alternatives: Mapping[str, tuple[Alternative, ...]]
) -> tuple[str, ...]:
    """Look-alikes that windows do not distinguish from it, and effects whose law is a part of it."""
    kept = {one.name for one in best.effects}
    names = [one.effect.name for one in alternatives.get(effect.name, ()) if not one.told_apart]
    own, null = best.own_values(effect), effect.at_null()
    names += [
        name for part, name in effect.shares.items() if abs(own[part] - null[part]) >= effect.strength[part]
    ]
    return tuple(name for name in dict.fromkeys(names) if name not in kept)


def sentence(effect: Effect, model: RefinedModel) -> str:
    """The effect's sentence with its fitted values."""
    values, units = model.own_values(effect), {q.name: q.unit for q in effect.parameters}
    faint = {name for name, least in effect.strength.items() if abs(values[name]) < NOTHING * least}
    return effect.says.format(
        **{
            name: "next to nothing" if name in faint else quantity(v, units[name])
            for name, v in values.items()
        }
    )


def unexplained_findings(s: TestedResult, suspects: Sequence[Suspicion]) -> tuple[Finding, ...]:
    """Findings that are not proven: where they are, what describes them, and what they could be.

    Where the recordings do not tell sites of different kinds apart, each has its own finding. A suspected effect is
    told in place of an unknown signal that lies at its kind of site.
    """
    if s.surrogate is None:
        return suspected_findings(s, suspects)
    found = [] if s.surrogate.contender is not None else _suspected_at_likely_sites(s, s.surrogate, suspects)
    if not found:
        described = s.best.effects[0] if s.best.effects and not s.names else None
        first = _at_all_samples(s, s.surrogate.at(described.sites[0] if described is not None else ""))
        words = _likely_sites(s.surrogate, first)
        found = [_unexplained_finding(s, first, described, words, tuple(suspects))]
    for one in s.surrogate.likely:
        if kind_of(one.site) not in {each.site for each in found}:
            words = f"an unknown signal at {one.site} explains the recordings as well"
            found.append(_unexplained_finding(s, _at_all_samples(s, one), None, words, ()))
    return tuple(found)


def _suspected_at_likely_sites(
    s: TestedResult, surrogate: Surrogate, suspects: Sequence[Suspicion]
) -> list[Finding]:
    """Suspected effects at the likely kinds of site; the first finding lists those elsewhere as well."""
    likely, kinds = {kind_of(one.site) for one in surrogate.likely}, {e.name: e.site for e in s.best.effects}
    there = tuple(one for one in suspects if kinds.get(one.effect) in likely)
    found = suspected_findings(s, there)
    elsewhere = tuple(one for one in suspects if one not in there)
    return [replace(found[0], suspected=(*found[0].suspected, *elsewhere)), *found[1:]] if found else []


def _likely_sites(surrogate: Surrogate, first: UnknownInput) -> str:
    best = surrogate.sites[0].site
    near = dict.fromkeys(
        one.site
        for one in surrogate.likely
        if one.site not in (best, first.site) and kind_of(one.site) == kind_of(first.site)
    )
    words = f"an unknown signal at {best} explains the recordings best"
    return words + (f"; {', '.join(near)} would do nearly as well" if near else "")


def _unexplained_finding(
    s: TestedResult,
    signal: UnknownInput,
    described: Effect | None,
    words: str,
    suspects: tuple[Suspicion, ...],
) -> Finding:
    """A mismatch without a name at one site, where an unknown signal and perhaps a surrogate describe it."""
    where = _mismatch_region(s, signal, described)
    evidence, law = Evidence(1.0, 0.0, 0.0), None
    followed: tuple[str, ...] = ()
    if described is not None:
        evidence, followed = s.test.names.get(described.name, evidence), described.depends_on
        law = effect_signal_at(s.base, s.best, signal.site)
        words += f"; {sentence(described, s.best)}, without a name"
    ranges = informative_ranges(where.states, tuple(name for name in followed if name in where.states))
    return Finding(
        effect=None,
        site=kind_of(signal.site),
        place=signal.site,
        parameters=(),
        region=where,
        shown=tuple(ranges),
        evidence=evidence,
        train_gain=signal.gain,
        delta_bic=0.0,
        indistinguishable=(),
        sentence=words,
        suspected=suspects,
        signal=signal,
        law=law,
    )


def _mismatch_region(s: TestedResult, first: UnknownInput, described: Effect | None) -> Region:
    """When and where an unnamed mismatch acts: from its surrogate, or else from the unknown input."""
    answer, signal = s.base.fit, first.signal / max(float(np.nanstd(first.signal)), 1e-300)
    centred = signal - np.nanmedian(signal)
    spread = np.repeat(centred[:, None], len(s.base.rig.model.outputs), axis=1)
    measured = np.isfinite(answer.filtered.innovations[0])
    if described is None:
        problem = answer.likelihood_problem.problem
        owner = np.repeat(problem.recording, problem.counts + 1)
        activity = share_of_largest(running_rms(centred, problem), owner)
    else:
        activity = effect_activity(s.best, described)
    return region(answer, np.where(measured, spread, np.nan), activity, s.problem.train)


def suspected_findings(s: TestedResult, suspects: Sequence[Suspicion]) -> tuple[Finding, ...]:
    """One finding for each effect of the best model that is suspected."""
    by_name = {effect.name: effect for effect in s.best.effects}
    return tuple(_suspected(s, by_name[one.effect], one) for one in suspects if one.effect in by_name)


def _suspected(s: TestedResult, effect: Effect, one: Suspicion) -> Finding:
    """An effect that is not proven, where it would act."""
    where, name = _region_of(s, effect), effect.name.replace("_", " ")
    return Finding(
        effect=None,
        site=effect.site,
        place=effect.sites[0],
        parameters=(),
        region=where,
        shown=tuple(informative_ranges(where.states, ())),
        evidence=s.test.names[effect.name],
        train_gain=0.0,
        delta_bic=0.0,
        indistinguishable=(),
        sentence=f"it could be {name} ({sentence(effect, s.best)}), but this is not proven: {one.why}",
        suspected=(one,),
    )
