"""A diagnosis in plain sentences with numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from optid.core.quantity import quantity
from optid.diagnosis.validation import error_gain
from optid.effects.description import Description
from optid.estimation.result import Estimate, Score

if TYPE_CHECKING:
    from optid.diagnosis.localisation.region import Range
    from optid.diagnosis.result import Diagnosis, Finding


def p_told(p: float) -> str:
    """A p-value in readable form."""
    return "p < 1e-6" if p < 1e-6 else f"p = {p:.2g}"


def summarise(d: Diagnosis) -> str:
    """Summarise where, what, how certain, how much better, and what is not known."""
    words = [ANSWERS[d.verdict.value](d).strip()]
    if d.path.ended_early:
        words.append(
            "The search stopped at its time limit before everything was tried: --time-limit gives it more."
        )
    if (bent := _at_bound(d, d.base_parameters)) and d.verdict.value != "parameters":
        words.append(f"A parameter of the base fit lies at its bound in the rig file: {', '.join(bent)}.")
    if d.best is not d.base and (bent := _at_bound(d, d.best_parameters)):
        words.append(
            f"With the effects found, a parameter of the rig still lies at its bound: {', '.join(bent)}."
        )
    return " ".join(words)


def _at_bound(d: Diagnosis, estimates: Sequence[Estimate]) -> list[str]:
    """The rig's own parameters that a fit left at a bound."""
    own = {f.name for f in d.base.rig.freed}
    return [e.name.replace("_", " ") for e in estimates if e.at_bound and e.name in own]


def _consistent(d: Diagnosis) -> str:
    return (
        f"The fitted model is as good as the noise allows: held out, its {_span(d)} windows have an error of "
        f"{_errors(d.test.base.scores)}; the noise is {_floor(d)}{_start_uncertainty(d)}. {_nothing_more(d)} "
        f"{_blind(d)}"
    )


def _start_uncertainty(d: Diagnosis) -> str:
    """What a correct model's windows err by, where the noise alone does not account for the errors."""
    scores, expected = d.test.base.scores, d.test.base.expected_errors(d.noise)
    most = d.problem.criteria.error_over_noise
    if all(s.rmse <= most * d.noise.get(role, math.inf) for role, s in scores.items()):
        return ""
    told = _by_role({role: quantity(rmse, scores[role].unit) for role, rmse in expected.items()})
    return f", and as the windows' starts are not known exactly, a correct model errs by {told}"


def _nothing_more(d: Diagnosis) -> str:
    """Whether any effect of the catalogue predicts the hold-out better, though not enough to be named."""
    strongest, p = d.path.strongest, d.test.p_value
    if strongest is None or not p <= d.test.level:
        return f"No effect of the catalogue improves it ({p_told(p)})."
    name = strongest.effects[-1].name
    return (
        f"{name.replace('_', ' ').replace('@', ' at ').capitalize()} predicts better ({p_told(p)}), but too "
        f"little to be named: {dict(d.rejected).get(name, 'other effects explain the same')}."
    )


def _parameters(d: Diagnosis) -> str:
    values = ", ".join(
        f"{e.name.replace('_', ' ')} {quantity(e.value, e.unit)}"
        for e in d.best_parameters
        if "." not in e.name
    )
    return (
        f"No physics is missing, but the model reaches the noise only with parameters outside the rig file's "
        f"bounds: {values}. Held out, windows have an error of {_errors(d.test.best.scores)} instead of "
        f"{_errors(d.test.base.scores)}."
    )


def _unexplained(d: Diagnosis) -> str:
    first, *others = [_sentence(d, f) for f in d.findings] or ["The site could not be determined."]
    told = " ".join([first, *(words.replace("Not explained at", "Or at", 1) for words in others)])
    described = ""
    if d.best is not d.base:
        empirical = any(isinstance(effect, Description) for effect in d.best.effects)
        what = "an empirical description, which names no effect" if empirical else "what is suspected"
        described = f" With {what}, windows have an error of {_errors(d.test.best.scores)}."
    suspected = [s for f in d.findings for s in f.suspected]
    also = ""
    if suspected:
        names = "; ".join(f"{s.effect.replace('_', ' ')} ({s.why})" for s in suspected)
        also = f" Suspected but not proven: {names}."
    return f"{_what_errs(d)} {told}{described}{also or _nearest(d)}"


def _what_errs(d: Diagnosis) -> str:
    """That something is not explained, and which windows show it."""
    first, most = d.path.first.error_over_noise, d.problem.criteria.error_over_noise
    if d.test.base.error_over_noise(d.noise) <= most < first:
        return (
            "The recordings to fit contain something that is not explained and that those held out do not show: "
            f"cross-validated, windows of the former have an error of {first:.2g} times the noise, of the latter "
            f"{_errors(d.test.base.scores)} where the noise is {_floor(d)}."
        )
    return (
        "The recordings contain something that is not explained: held out, windows have an error of "
        f"{_errors(d.test.base.scores)} where the noise is {_floor(d)}."
    )


def _nearest(d: Diagnosis) -> str:
    """The law of the catalogue that comes nearest where none is proven or suspected: where to look first."""
    one = d.path.nearest
    if one is None or d.path.best.effects or not one.why:
        return ""
    gain = error_gain(d.path.first, one.validated)
    if gain < d.problem.criteria.smallest_gain:
        return ""
    name = one.effect.name.replace("_", " ").replace("@", " at ")
    return f" Of the catalogue {name} comes nearest, {100 * gain:.0f} % less error; not proven: {one.why}."


def _missing(d: Diagnosis) -> str:
    found = " ".join(_sentence(d, f) for f in d.findings)
    ratio, rest = d.test.error_over_noise, ""
    if ratio > d.problem.criteria.error_over_noise:
        much = f"{ratio:.1f} times the noise" if ratio < 100 else "far above the noise"
        rest = f" What remains is {much}: the law's form may differ from the catalogue's."
    return (
        f"{found} Held out, the error of {_span(d)} windows falls from {_errors(d.test.base.scores)} to "
        f"{_errors(d.test.best.scores)}; the noise is {_floor(d)}.{rest}"
    )


ANSWERS = {
    "consistent": _consistent,
    "parameters": _parameters,
    "unexplained": _unexplained,
    "missing-physics": _missing,
}


def _span(d: Diagnosis) -> str:
    return f"{d.test.base.horizon:.3g} s"


def _floor(d: Diagnosis) -> str:
    units = {port.role: port.unit for port in d.best.rig.model.outputs}
    return _by_role({role: quantity(sd, units[role]) for role, sd in d.noise.items()})


def _errors(scores: Mapping[str, Score]) -> str:
    return _by_role({role: quantity(s.rmse, s.unit) for role, s in scores.items()})


def _by_role(told: Mapping[str, str]) -> str:
    """The same words for every output, or for the only one."""
    if len(told) == 1:
        return next(iter(told.values()))
    return ", ".join(f"{role.replace('_', ' ')} {words}" for role, words in told.items())


def _sentence(d: Diagnosis, f: Finding) -> str:
    name = "Not explained" if f.effect is None else f.effect.name.replace("_", " ").capitalize()
    sure = "" if f.effect is None else f" ({p_told(f.evidence.p_value)} on the hold-out)"
    where = _when(f) + (_where(f.shown[0], f.region.states[f.shown[0]]) if f.shown else "")
    also = ""
    if f.indistinguishable:
        also = f" These recordings cannot distinguish it from {', '.join(f.indistinguishable)}."
        also += (
            f" An experiment that can: {f.effect.experiment}."
            if f.effect is not None and f.effect.experiment
            else ""
        )
    place = "" if "@" in name else f" at the {f.site}"
    return f"{name.replace('@', ' at ')}{place}: {f.sentence}{sure}.{where}{also}"


def _when(f: Finding) -> str:
    """That a law acts all the time, where it does and singles out no range."""
    ranged = any(f.region.states[name].by_law for name in f.shown)
    return " It acts all the time." if f.effect is not None and f.region.always and not ranged else ""


def _where(signal: str, r: Range) -> str:
    """The range of a signal in which something acts; empty where it tells nothing."""
    name, span = signal.replace("_", " "), f"{quantity(r.low, r.unit)} to {quantity(r.high, r.unit)}"
    if r.by_law:
        return f" It acts at {name} from {span}."
    if not r.informative:
        return ""
    return (
        f" {100 * r.share:.0f} % of the mismatch lies at {name} from {span}, "
        f"and {100 * r.occupancy:.0f} % of the samples."
    )


def _blind(d: Diagnosis) -> str:
    names = [name.replace("_", " ") for name, _, _ in d.not_testable]
    return f"These recordings could not show: {', '.join(names)}." if names else ""
