"""What everything amounts to: which names are proven, what remains, and the verdict."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from optid.diagnosis.alternatives import Alternative
from optid.diagnosis.criteria import Criteria
from optid.diagnosis.findings import named_findings, unexplained_finding
from optid.diagnosis.intervals import intervals
from optid.diagnosis.problem import DiagnosisProblem
from optid.diagnosis.refinement import RefinedModel
from optid.diagnosis.result import Diagnosis, Suspicion, Verdict
from optid.diagnosis.selection import SelectionPath
from optid.diagnosis.summary import quantity, summarise
from optid.diagnosis.surrogate.search import Surrogate
from optid.diagnosis.testing import HoldoutTest
from optid.effects.description import Description
from optid.effects.library import admitted

VISIBLE = 5.0  # sd by which windows' errors must change for an effect to be found for sure


def is_sufficient(path: SelectionPath, problem: DiagnosisProblem) -> bool:
    """The names bring cross-validated windows to the noise, or leave no more than right laws of another form may."""
    c = problem.criteria
    if path.validated.error_over_noise <= c.error_over_noise:
        return True
    share = 1.0 - path.validated.excess / max(path.first.excess, 1e-300)
    return bool(path.best.effects) and share >= 1.0 - largest_rest(problem)


def largest_rest(problem: DiagnosisProblem) -> float:
    """Share of the squared error that names may leave on this plant."""
    stated = problem.plain.form_error
    return problem.criteria.largest_rest if stated is None else stated


def conclude(
    problem: DiagnosisProblem,
    path: SelectionPath,
    alternatives: Mapping[str, tuple[Alternative, ...]],
    surrogate: Surrogate | None,
    base: RefinedModel,
    best: RefinedModel,
    test: HoldoutTest,
    holdout: Sequence[str],
    wide: bool,
) -> Diagnosis:
    """The answer; `best` is the model that stands for it, `wide` that it is the base with wider bounds."""
    c = problem.criteria
    suspects = _suspects(path, test, c)
    after = test.best.error_over_noise(problem.noise)
    share = test.best.explained_share(test.base, problem.noise)
    held = after <= c.error_over_noise or share >= 1.0 - largest_rest(problem)
    described = any(isinstance(effect, Description) for effect in best.effects)
    names = bool(best.effects) and not described
    if wide:
        verdict = (
            Verdict.PARAMETERS
            if after <= c.error_over_noise and test.p_value <= c.level
            else Verdict.UNEXPLAINED
        )
    elif names and held and not suspects:
        verdict = Verdict.MISSING_PHYSICS
    elif not names and surrogate is None and test.base.error_over_noise(problem.noise) <= c.error_over_noise:
        verdict = Verdict.CONSISTENT
    else:
        verdict = Verdict.UNEXPLAINED
    if verdict is Verdict.UNEXPLAINED and names:
        why = f"it explains {100 * share:.0f} % of the squared error on the hold-out"
        suspects = suspects or tuple(Suspicion(effect.name, why) for effect in best.effects)
    ratio = max(after, 1.0) if math.isfinite(after) and after > c.error_over_noise else 1.0
    before = test.base.error_over_noise(problem.noise)
    base_parameters = intervals(base, max(before, 1.0) if before > c.error_over_noise else 1.0)
    best_parameters = base_parameters if best is base else intervals(best, ratio)
    if verdict is Verdict.MISSING_PHYSICS:
        findings = named_findings(problem, path, alternatives, base, best, best_parameters, test)
    elif verdict is Verdict.UNEXPLAINED:
        findings = unexplained_finding(problem, path, surrogate, base, best, test, suspects)
    else:
        findings = ()
    diagnosis = Diagnosis(
        verdict,
        "",
        base,
        best,
        base_parameters,
        best_parameters,
        findings,
        _rejected(path, alternatives),
        _not_testable(path, problem),
        test,
        path,
        alternatives,
        problem,
        tuple(holdout),
        problem.noise,
    )
    return replace(diagnosis, summary=summarise(diagnosis))


def _suspects(path: SelectionPath, test: HoldoutTest, c: Criteria) -> tuple[Suspicion, ...]:
    """Names that the hold-out does not confirm, each with why."""
    found = []
    for effect in path.best.effects:
        evidence = test.names.get(effect.name)
        if evidence is None:
            continue
        if not evidence.p_value <= c.level:
            found.append(
                Suspicion(effect.name, f"the hold-out does not confirm it (p = {evidence.p_value:.2g})")
            )
        elif not evidence.error_gain > 0.0:
            found.append(Suspicion(effect.name, "no output of the hold-out is predicted better"))
    return tuple(found)


def _rejected(
    path: SelectionPath, alternatives: Mapping[str, tuple[Alternative, ...]]
) -> tuple[tuple[str, str], ...]:
    """Every effect that was fitted and not kept, with the last reason."""
    kept = {effect.name for effect in path.best.effects}
    reasons: dict[str, str] = {}
    for one in path.rounds:
        for contender in one.contenders:
            if contender.effect.name not in kept and contender is not one.taken:
                beaten = f"{one.taken.effect.name} explains more" if one.taken else "not confirmed"
                reasons[contender.effect.name] = contender.why or beaten
    reasons |= {
        effect.name: f"beside the others: {why}" for effect, why in path.dropped if effect.name not in kept
    }
    for name, others in alternatives.items():
        for other in others:
            if name in kept and other.told_apart:
                reasons[other.effect.name] = f"in its place {name} predicts better"
    return tuple((name, why) for name, why in reasons.items() if name not in kept)


def _not_testable(path: SelectionPath, problem: DiagnosisProblem) -> tuple[tuple[str, str, str], ...]:
    """Effects that these recordings would not show at the smallest size worth a name."""
    if not path.rounds:
        return ()
    visible, rows = path.rounds[0].proposals.visible, []
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
