"""Consistency of the evidence for a named effect: the test on the hold-out, the interval of its size, every output."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from optid.core.quantity import quantity
from optid.diagnosis.criteria import Criteria
from optid.diagnosis.evaluation import Evaluation
from optid.diagnosis.testing import Evidence, worse_output
from optid.effects.effect import Effect
from optid.estimation.result import Estimate


def disagreement(
    effect: Effect,
    estimates: Sequence[Estimate],
    evidence: Evidence,
    before: Evaluation,
    after: Evaluation,
    noise: Mapping[str, float],
    criteria: Criteria,
) -> str:
    """Why a named effect is not proven; empty if all evidence agrees.

    Args:
        effect: the selected one.
        estimates: its parameters by own name, with intervals, SI.
        evidence: on the hold-out, compared with the model without it.
        before, after: the original model and the one with all named effects, on the hold-out.
        noise: role -> sd of the measurement, SI.
        criteria: what counts as proof.
    """
    if why := no_confirmation(evidence, criteria):
        return why
    if not evidence.error_gain > 0.0:
        return "it predicts no output of the hold-out better"
    why = _no_size(effect, estimates) or _at_range_end(effect, estimates)
    return why or worse_output(before, after, noise, criteria)


def no_confirmation(evidence: Evidence, criteria: Criteria) -> str:
    """Why the hold-out alone speaks against an effect; empty if it confirms it."""
    if evidence.p_value <= criteria.level:
        return ""
    return f"the hold-out does not confirm it (p = {evidence.p_value:.2g})"


def _no_size(effect: Effect, estimates: Sequence[Estimate]) -> str:
    """Whether zero is inside the intervals of all its strengths: the reason in words, or empty."""
    null = effect.at_null()
    sizes = [one for one in estimates if one.name in effect.strength]
    if not sizes or any(not one.low <= null[one.name] <= one.high for one in sizes):
        return ""
    told = ", ".join(
        f"{one.name.replace('_', ' ')} {quantity(one.low, one.unit)} to {quantity(one.high, one.unit)}"
        for one in sizes
    )
    return f"its confidence interval includes an effect of no size ({told})"


def _at_range_end(effect: Effect, estimates: Sequence[Estimate]) -> str:
    """Which strength is at an end of its plausible range: the reason in words, or empty.

    A share may be all there is: 0 and 1 are meant.
    """
    null, ranges = effect.at_null(), {one.name: one.bounds for one in effect.parameters}
    for one in estimates:
        if one.name not in effect.strength or one.value == null[one.name]:
            continue
        if one.at_bound and ranges[one.name] != (0.0, 1.0):
            name, value = one.name.replace("_", " "), quantity(one.value, one.unit)
            return f"its {name} lies at an end of the plausible range, at {value}"
    return ""
