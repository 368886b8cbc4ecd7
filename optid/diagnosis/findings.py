"""Findings: what is missing, where and when it acts, and what it may be confused with."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from optid.core.model import Array
from optid.diagnosis.alternatives import Alternative
from optid.diagnosis.localisation.activity import effect_activity
from optid.diagnosis.localisation.effect_signal import effect_signal_at
from optid.diagnosis.localisation.region import (
    by_usual_size,
    contribution,
    informative_ranges,
    region,
    running_rms,
)
from optid.diagnosis.localisation.unknown_input import UnknownInput, locate_at
from optid.diagnosis.problem import DiagnosisProblem
from optid.diagnosis.refinement import RefinedModel
from optid.diagnosis.result import Finding, Suspicion
from optid.diagnosis.selection import SelectionPath
from optid.diagnosis.summary import quantity
from optid.diagnosis.surrogate.library import kind_of
from optid.diagnosis.surrogate.search import Surrogate
from optid.diagnosis.testing import Evidence, HoldoutTest
from optid.effects.effect import Effect
from optid.estimation.result import Estimate

NOTHING = 0.01  # of the smallest size worth a name: what is below it is told in words


def named_findings(
    problem: DiagnosisProblem,
    path: SelectionPath,
    alternatives: Mapping[str, tuple[Alternative, ...]],
    base: RefinedModel,
    best: RefinedModel,
    parameters: Sequence[Estimate],
    test: HoldoutTest,
) -> tuple[Finding, ...]:
    """One of every named effect, the strongest first."""
    found = []
    for effect in best.effects:
        problem.report(0.97, f"where and when {effect.name} acts")
        where = region(
            best.answer,
            contribution(best.answer, _at_null(best, effect)),
            effect_activity(base, best, effect),
            problem.train,
        )
        ranges = informative_ranges(where.states, tuple(s for s in effect.depends_on if s in where.states))
        own = tuple(
            replace(e, name=e.name.removeprefix(f"{effect.name}."))
            for e in parameters
            if e.name.startswith(f"{effect.name}.")
        )
        _, errors = path.without[effect.name]
        gain = float(errors.windows.sum() - path.validated.windows.sum())
        bic = 2.0 * gain - len(effect.fitted) * math.log(len(path.validated.windows))
        signal, law = _signal(problem, path, base, best, effect)
        found.append(
            Finding(
                effect,
                effect.site,
                effect.sites[0],
                own,
                where,
                tuple(ranges),
                test.names[effect.name],
                gain,
                bic,
                _indistinguishable(best, effect, alternatives),
                sentence(effect, best),
                (),
                signal,
                law,
            )
        )
    return tuple(sorted(found, key=lambda f: -f.train_gain))


def _at_null(best: RefinedModel, effect: Effect) -> np.ndarray:
    p = best.answer.p.copy()
    for name, null in effect.qualified(effect.at_null()).items():
        if name.removeprefix(f"{effect.name}.") in effect.strength:
            p[best.rig.model.index(name)] = null
    return p


def _signal(
    problem: DiagnosisProblem, path: SelectionPath, base: RefinedModel, best: RefinedModel, effect: Effect
) -> tuple[UnknownInput | None, Array | None]:
    """The unknown input at the effect's site and the law there, at the first of its sites that the law changes."""
    for site in effect.sites:
        law = effect_signal_at(base, best, site)
        if law is not None and np.isfinite(law).all() and np.ptp(law) > 0.0:
            return locate_at(path.base, problem, site), law
    return None, None


def _indistinguishable(
    best: RefinedModel, effect: Effect, alternatives: Mapping[str, tuple[Alternative, ...]]
) -> tuple[str, ...]:
    """Look-alikes that windows do not tell from it, and effects whose whole law a part of it is."""
    kept = {one.name for one in best.effects}
    names = [one.effect.name for one in alternatives.get(effect.name, ()) if not one.told_apart]
    own, null = best.own_values(effect), effect.at_null()
    names += [
        name for part, name in effect.shares.items() if abs(own[part] - null[part]) >= effect.strength[part]
    ]
    return tuple(name for name in dict.fromkeys(names) if name not in kept)


def sentence(effect: Effect, model: RefinedModel) -> str:
    """What an engineer would say of it, with the values that were fitted."""
    values, units = model.own_values(effect), {q.name: q.unit for q in effect.parameters}
    faint = {name for name, least in effect.strength.items() if abs(values[name]) < NOTHING * least}
    return effect.says.format(
        **{
            name: "next to nothing" if name in faint else quantity(v, units[name])
            for name, v in values.items()
        }
    )


def unexplained_finding(
    problem: DiagnosisProblem,
    path: SelectionPath,
    surrogate: Surrogate | None,
    base: RefinedModel,
    best: RefinedModel,
    test: HoldoutTest,
    suspects: tuple[Suspicion, ...],
) -> tuple[Finding, ...]:
    """What is not proven, as a finding: where it lies, what describes it, and what it could be."""
    if surrogate is None or not surrogate.sites:
        return tuple(_suspected(problem, base, best, one, test) for one in suspects)
    described = best.effects[0] if best.effects and surrogate.contender is not None else None
    first = surrogate.sites[0]
    if described is not None:
        sites = [one for one in surrogate.sites if described.sites[0] in one.sites]
        first = sites[0].only(described.sites[0]) if sites else first
    answer, signal = base.answer, first.signal / max(float(np.nanstd(first.signal)), 1e-300)
    centred = signal - np.nanmedian(signal)
    spread = np.repeat(centred[:, None], len(base.rig.model.outputs), axis=1)
    measured = np.isfinite(answer.filtered.innovations[0])
    if described is None:
        activity = by_usual_size(running_rms(centred, answer.question.problem))
    else:
        activity = effect_activity(base, best, described)
    where = region(answer, np.where(measured, spread, np.nan), activity, problem.train)
    words = f"an unknown signal at {surrogate.sites[0].site} explains the recordings best"
    near = dict.fromkeys(
        one.site for one in surrogate.likely if one.site not in (surrogate.sites[0].site, first.site)
    )
    words += f"; {', '.join(near)} would do nearly as well" if near else ""
    evidence, law = Evidence(1.0, 0.0, 0.0), None
    followed: tuple[str, ...] = ()
    if described is not None:
        evidence, followed = test.names.get(described.name, evidence), described.depends_on
        law = effect_signal_at(base, best, first.site)
        words += f"; {sentence(described, best)}, without a name"
    ranges = informative_ranges(where.states, tuple(name for name in followed if name in where.states))
    return (
        Finding(
            None,
            kind_of(first.site),
            first.site,
            (),
            where,
            tuple(ranges),
            evidence,
            first.gain,
            0.0,
            (),
            words,
            suspects,
            first,
            law,
        ),
    )


def _suspected(
    problem: DiagnosisProblem, base: RefinedModel, best: RefinedModel, one: Suspicion, test: HoldoutTest
) -> Finding:
    """A name that is not proven, where it would act."""
    effect = next(e for e in best.effects if e.name == one.effect)
    mismatch = contribution(best.answer, _at_null(best, effect))
    where = region(best.answer, mismatch, effect_activity(base, best, effect), problem.train)
    words = f"it could be {effect.name.replace('_', ' ')} ({sentence(effect, best)}), which is not proven: {one.why}"
    return Finding(
        None,
        effect.site,
        effect.sites[0],
        (),
        where,
        tuple(informative_ranges(where.states, ())),
        test.names[effect.name],
        0.0,
        0.0,
        (),
        words,
        (one,),
    )
