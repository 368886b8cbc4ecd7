"""The conclusion: which effects are proven, what remains, and the verdict."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from optid.core.quantity import quantity
from optid.diagnosis.agreement import disagreement, no_confirmation
from optid.diagnosis.alternatives import Alternative
from optid.diagnosis.evaluation import Evaluation
from optid.diagnosis.findings import (
    named_findings,
    own_estimates,
    suspected_findings,
    unexplained_findings,
)
from optid.diagnosis.intervals import apart_from_none, intervals, joint_p_value
from optid.diagnosis.problem import DiagnosisProblem
from optid.diagnosis.result import Diagnosis, Finding, Suspicion, Verdict
from optid.diagnosis.selection.path import SelectionPath
from optid.diagnosis.summary import summarise
from optid.diagnosis.surrogate.search import Surrogate, localise
from optid.diagnosis.tested_result import TestedResult
from optid.diagnosis.validation import error_gain
from optid.effects.library import admitted, untestable
from optid.effects.sticking import Sticking
from optid.estimation.result import Estimate

VISIBLE = 5.0  # sd by which windows' errors must change for an effect to be detected with certainty


def is_sufficient(path: SelectionPath, problem: DiagnosisProblem) -> bool:
    """Whether the named effects bring cross-validated windows to the noise, or leave no more than right laws may."""
    share = 1.0 - path.validated.excess / max(path.first.excess, 1e-300)
    return _at_noise(path, problem) or (bool(path.best.effects) and share >= 1.0 - largest_rest(problem))


def leaves_mismatch(path: SelectionPath, problem: DiagnosisProblem) -> bool:
    """Whether the whole search leaves a mismatch."""
    return not _at_noise(path, problem) and not path.ended_early


def gains_alone(path: SelectionPath, problem: DiagnosisProblem) -> bool:
    """Whether the effects of a path predict better than the base by as much as a name must."""
    return error_gain(path.first, path.validated) >= problem.criteria.smallest_gain


def is_beyond_doubt(path: SelectionPath, problem: DiagnosisProblem) -> bool:
    """Whether the named effects suffice and leave only the noise, or what the plant states for right laws.

    Where a plant states nothing, right and wrong effects may both leave much: surrogates decide.
    """
    stated = problem.plain.form_error is not None
    return is_sufficient(path, problem) and (_at_noise(path, problem) or stated)


def is_explained_elsewhere(
    path: SelectionPath, surrogate: Surrogate | None, problem: DiagnosisProblem
) -> bool:
    """Whether a surrogate at another place, or over other signals, speaks against the named effects.

    It is at the noise where they are not and leave more than a right law may by its form, or explains most of an
    output's error of which they explain less than half: a law at fault elsewhere may put one output right, as the gain
    of a valve does for the position, and leave the pressures as they were.
    """
    described = None if surrogate is None else surrogate.contender
    if described is None or _at_noise(path, problem):
        return False
    sites = {site for effect in path.best.effects for site in effect.sites}
    signals = {signal for effect in path.best.effects for signal in effect.depends_on}
    apart = sites.isdisjoint(described.effect.sites) or signals.isdisjoint(described.effect.depends_on)
    apart |= isinstance(described.effect, Sticking)  # in place of a law of the same input
    most = problem.criteria.error_over_noise
    before, named, free = (one.by_output for one in (path.first, path.validated, described.validated))
    half = 0.5 * (before - 1.0)
    left_out = (before > most**2) & (named - 1.0 > half) & (free - 1.0 < half)
    more = path.validated.excess - described.validated.excess
    at_noise = described.validated.error_over_noise <= most
    better = at_noise and more >= problem.criteria.smallest_share * path.first.excess
    return apart and (better or bool(left_out.any()))


def _at_noise(path: SelectionPath, problem: DiagnosisProblem) -> bool:
    return path.validated.error_over_noise <= problem.criteria.error_over_noise


def largest_rest(problem: DiagnosisProblem) -> float:
    """Share of the squared error that named effects may leave on this plant."""
    stated = problem.plain.form_error
    return problem.criteria.largest_rest if stated is None else stated


def conclude(s: TestedResult, doubted: TestedResult | None = None) -> Diagnosis:
    """The answer of all stages; beside it what the hold-out does not confirm of a larger answer is suspected."""
    if s.test.refuted and not s.wide and (not s.names or _is_contradicted(s)):
        # A surrogate is kept only if it predicts better, and so is a name beside a base at the noise.
        s = replace(s, best=s.base, test=s.test.of_base(s.problem.noise))
    base_parameters = intervals(s.base, _birge(s, s.test.base))
    best_parameters = base_parameters if s.best is s.base else _best_parameters(s)
    suspects = _suspects(s, best_parameters)
    verdict = _verdict(s, suspects)
    findings: tuple[Finding, ...] = ()
    if verdict is Verdict.MISSING_PHYSICS:
        findings = named_findings(s, best_parameters, suspects)
        findings += () if doubted is None else suspected_findings(doubted, _unconfirmed_effects(doubted))
    elif verdict is Verdict.UNEXPLAINED:
        if s.surrogate is None and not s.wide and not _base_fits_training(s):
            s = replace(s, surrogate=localise(s.path, s.search))
        findings = unexplained_findings(s, suspects or _fallen_short(s))
        if s.test.refuted and s.names:
            s, best_parameters = (
                replace(s, best=s.base, test=s.test.of_base(s.problem.noise)),
                base_parameters,
            )
    diagnosis = Diagnosis(
        verdict=verdict,
        summary="",
        base=s.base,
        best=s.best,
        base_parameters=base_parameters,
        best_parameters=best_parameters,
        findings=findings,
        rejected=_rejected(s.path, s.alternatives),
        not_testable=_not_testable(s.path, s.problem),
        test=s.test,
        path=s.path,
        alternatives=s.alternatives,
        problem=s.problem,
        holdout=s.holdout,
        noise=s.problem.noise,
    )
    return replace(diagnosis, summary=summarise(diagnosis))


def _verdict(s: TestedResult, suspects: Sequence[Suspicion]) -> Verdict:
    """The verdict; values that are not finite, not tested or not confirmed support no claim: NaN compares as false."""
    c, noise = s.problem.criteria, s.problem.noise
    ratio = s.test.best.error_over_noise(noise)
    at_noise = ratio <= c.error_over_noise
    if s.wide:
        return Verdict.PARAMETERS if at_noise and s.test.p_value <= c.level else Verdict.UNEXPLAINED
    if s.names:
        enough = at_noise or (math.isfinite(ratio) and is_sufficient(s.path, s.search))
        proven = len(suspects) < len(s.best.effects)
        return Verdict.MISSING_PHYSICS if enough and proven else Verdict.UNEXPLAINED
    silent = not s.best.effects and s.surrogate is None
    return Verdict.CONSISTENT if silent and at_noise else Verdict.UNEXPLAINED


def _base_fits_training(s: TestedResult) -> bool:
    """Whether the base is at the noise on the training recordings: these then do not show where anything is missing."""
    return s.path.first.error_over_noise <= s.search.criteria.error_over_noise


def _is_contradicted(s: TestedResult) -> bool:
    """Whether a base at the noise predicts every output held out better than with any of the selected effects."""
    ratios = s.path.first.error_over_noise, s.test.base.error_over_noise(s.problem.noise)
    at_noise = all(ratio <= s.problem.criteria.error_over_noise for ratio in ratios)
    return at_noise and all(evidence.error_gain <= 0.0 for evidence in s.test.names.values())


def _birge(s: TestedResult, evaluation: Evaluation) -> float:
    """Ratio of a model's errors to the expected ones; 1 where it is at the noise, infinite where it diverged.

    Birge's ratio is of residuals to the variances that an interval was computed with. Those are the filter's, whose
    process noise includes the law's error: windows' errors over the measurement noise would count it twice.
    """
    squares = np.nanmean(np.asarray(evaluation.innovations) ** 2, axis=0)
    windows = evaluation.error_over_noise(s.problem.noise)
    ratio = min(windows, math.sqrt(float(np.nanmax(squares)))) if math.isfinite(windows) else math.inf
    return 1.0 if ratio <= s.problem.criteria.error_over_noise else ratio


def _best_parameters(s: TestedResult) -> tuple[Estimate, ...]:
    """The best model's parameters, with intervals consistent with the tests of the named effects."""
    ratio = _birge(s, s.test.best)
    estimates = intervals(s.best, ratio)
    at_noise = s.test.best.error_over_noise(s.problem.noise) <= s.problem.criteria.error_over_noise
    for effect in s.best.effects if s.names else ():
        p = s.test.names[effect.name].p_value
        if p <= s.problem.criteria.level:
            sure = at_noise or joint_p_value(s.best, effect, ratio) <= s.problem.criteria.level
            estimates = apart_from_none(estimates, effect, p, sure)
    return estimates


def _suspects(s: TestedResult, estimates: Sequence[Estimate]) -> tuple[Suspicion, ...]:
    """Effects of the best model without consistent evidence, each with the reason."""
    found = []
    for effect in s.best.effects if s.names else ():
        evidence, own = s.test.names[effect.name], own_estimates(effect, estimates)
        why = disagreement(
            effect, own, evidence, s.test.base, s.test.best, s.problem.noise, s.problem.criteria
        )
        if why := why or _why_not_alone(s):
            found.append(Suspicion(effect.name, why))
    return tuple(found)


def _why_not_alone(s: TestedResult) -> str:
    """Why confirmed effects are not proven without those that the hold-out does not confirm; empty if they are."""
    if s.confirmed is None or gains_alone(s.confirmed, s.search):
        return ""
    others = " and ".join(one.replace("_", " ") for one in s.unconfirmed)
    explained = 1.0 - s.confirmed.validated.excess / max(s.confirmed.first.excess, 1e-300)
    return (
        f"without {others}, which the hold-out does not confirm, it explains {100 * max(explained, 0.0):.0f} % of the "
        "squared error of windows that were not fitted"
    )


def _unconfirmed_effects(s: TestedResult) -> tuple[Suspicion, ...]:
    """Effects that the hold-out does not confirm where it confirms others."""
    tests = s.test.names
    return tuple(Suspicion(name, no_confirmation(tests[name], s.problem.criteria)) for name in s.unconfirmed)


def _fallen_short(s: TestedResult) -> tuple[Suspicion, ...]:
    """Effects that were selected and do not explain enough."""
    explained = 1.0 - s.path.validated.excess / max(s.path.first.excess, 1e-300)
    why = f"it explains {100 * explained:.0f} % of the squared error of windows that were not fitted"
    if s.names and not math.isfinite(s.test.best.error_over_noise(s.problem.noise)):
        why = "a prediction of the hold-out diverged"
    described = None if s.names or s.surrogate is None else s.surrogate.contender
    if described is not None and is_explained_elsewhere(s.path, s.surrogate, s.search):
        (site, *_) = described.effect.sites
        left = described.validated.error_over_noise
        why += f"; a description at {site} brings them to {left:.2g} times the noise"
    return tuple(Suspicion(effect.name, why) for effect in s.path.best.effects)


def _rejected(
    path: SelectionPath, alternatives: Mapping[str, tuple[Alternative, ...]]
) -> tuple[tuple[str, str], ...]:
    """Every effect that was fitted and not kept, with the last reason."""
    reasons: dict[str, str] = {}
    for one in (*path.earlier, *path.rounds):
        beaten = f"{one.taken.effect.name} explains more" if one.taken else "not confirmed"
        reasons |= {c.effect.name: c.why or beaten for c in one.contenders if c is not one.taken}
    reasons |= {effect.name: f"beside the others: {why}" for effect, why in path.dropped}
    for name, others in alternatives.items():
        reasons |= {o.effect.name: f"in its place {name} predicts better" for o in others if o.told_apart}
    kept = {effect.name for effect in path.best.effects}
    return tuple((name, why) for name, why in reasons.items() if name not in kept)


def _not_testable(path: SelectionPath, problem: DiagnosisProblem) -> tuple[tuple[str, str, str], ...]:
    """Effects that would not be visible in these recordings at the smallest size worth a name."""
    rounds = (*path.earlier, *path.rounds)
    if not rounds:
        return ()
    visible = rounds[0].proposals.visible
    rows = [
        (effect.name, f"nothing recorded shows {' or '.join(effect.places)}", "")
        for effect in untestable(problem.rig.model, problem.own)
    ]
    kept = {effect.name for effect in path.best.effects}
    for effect in admitted(problem.rig.model, problem.own):
        sd = visible.get(effect.name, 0.0)
        if effect.name in kept or sd >= VISIBLE:
            continue
        name, least = next(iter(effect.strength.items()))
        unit = next(q.unit for q in effect.parameters if q.name == name)
        if sd <= 0.0:
            rows.append(
                (effect.name, f"nothing in these recordings would change; it needs {effect.needs}", "")
            )
        else:
            size = quantity(least, unit)
            why = f"at {size} windows would change by {sd:.1f} sd after a refit; it needs {effect.needs}"
            rows.append((effect.name, why, f"{name} {quantity(least * VISIBLE / sd, unit)}"))
    return tuple(rows)
