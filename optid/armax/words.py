"""An audit in sentences."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from optid.armax.loop import Loop
from optid.armax.residuals import ResidualTests

if TYPE_CHECKING:
    from optid.armax.audit import Audit
    from optid.armax.identifiability import OpenDirection
    from optid.armax.model import Armax


TWO_SIDED = 1.96
LOPSIDED = 0.1  # share of an interval's width by which its sides may differ and still be written as ±
NEAR_ONE = 0.01  # a cancelled pole this near to 1 describes an offset or a drift
SURE = 3.0  # standard errors within which a pole may be an integrator's
SLOW = 1e-3  # a pole this little outside 1 needs a thousand samples to grow by e


@dataclass(frozen=True)
class Finding:
    """A finding: a fixed name, whether it is an alarm, and a sentence."""

    name: str
    grave: bool
    text: str


def findings(audit: Audit) -> tuple[Finding, ...]:
    """All findings, alarms first."""
    said = [*_stability(audit), *_cancelled(audit), *_noise_cancelled(audit), *_contents(audit)]
    if audit.residuals is not None:
        said += _residuals(audit.residuals)
    if audit.loop is not None:
        said.append(_loop(audit.loop))
    return tuple(sorted(said, key=lambda finding: not finding.grave))


def number(root: complex) -> str:
    """A root in readable form."""
    real = round(root.real, 4) + 0.0  # no minus zero
    return f"{real:.4f}±{root.imag:.4f}i" if root.imag else f"{real:.4f}"


def _finding(name: str, grave: bool, text: str) -> Finding:
    return Finding(name, grave, text)


def _stability(audit: Audit) -> list[Finding]:
    outside = [p for p in audit.poles if abs(p) >= 1.0 and p.imag >= 0.0]
    if not outside:
        slowest = max((abs(p) for p in audit.poles), default=0.0)
        return [_finding("stable", False, f"Stable: the largest pole has modulus {slowest:.4f}.")]
    pairs = zip(audit.poles, audit.pole_errors, strict=True)
    near = [(p, sd) for p, sd in pairs if not p.imag and abs(p - 1.0) <= _margin(sd)]
    if len(outside) == 1 and outside[0] in [p for p, _ in near]:
        sd = dict(near)[outside[0]]
        margin = f" ± {sd:.1g}" if not math.isnan(sd) else ""
        text = f"A pole at {outside[0].real:.4f}{margin}: within its uncertainty it is an integrator."
        return [_finding("integrating", False, text)]
    tests = audit.residuals
    coloured = tests is not None and not (tests.white and tests.independent)
    if len(outside) == 1 and not outside[0].imag and abs(outside[0] - 1.0) <= SLOW and coloured:
        text = (
            f"A pole at {outside[0].real:.4f}: an integrator, or slowly unstable. The data do not decide it, "
            "because with these residuals the standard error is too small."
        )
        return [_finding("integrating", False, text)]
    listed = ", ".join(number(p) for p in outside)
    return [_finding("unstable", True, f"Unstable: pole {listed} lies on or outside the unit circle.")]


def _margin(sd: float) -> float:
    return 1e-9 if not math.isfinite(sd) else max(1e-9, SURE * sd)


def _cancelled(audit: Audit) -> list[Finding]:
    said = [
        _finding(
            "cancellation",
            True,
            f"The pole {number(c.pole)} is nearly cancelled by the zero {number(c.zero)}: without both the "
            f"response changes by at most {100 * c.effect:.2g} %.",
        )
        for c in audit.cancellations
    ]
    if said:
        text = f"Its order is {audit.order}, its effective order {audit.effective_order}."
        said.append(_finding("effective_order", True, text))
    return said


def _noise_cancelled(audit: Audit) -> list[Finding]:
    said = []
    by_zero = [c.pole for c in audit.cancellations]
    for c in audit.noise_cancellations:
        pair = f"The pole {number(c.pole)} is nearly cancelled by the root {number(c.root)} of C"
        if c.empty or c.pole in by_zero:
            text = (
                f"{pair}, and the input hardly excites it: A, B and C share a factor, so a lower order would be "
                "enough."
            )
            said.append(_finding("common_factor", True, text))
        else:
            text = f"{pair}: the noise does not excite it, which is what sensor noise does."
            said.append(_finding("noise_cancellation", False, text))
    drifting = [p for p in by_zero if not p.imag and abs(p - 1.0) < NEAR_ONE]
    if drifting:
        text = (
            f"A pole at {drifting[0].real:.4f} beside a zero: an offset or a drift of the recording that "
            "constant and slope do not describe would look like this."
        )
        said.append(_finding("drift", True, text))
    return said


def _static_gain(audit: Audit) -> Finding:
    gain, error = audit.static_gain, audit.static_gain_error
    said = f"Static gain {_significant(gain, error)}"
    if math.isinf(gain) or _stability(audit)[0].name == "integrating":
        return _finding("static_gain", False, "No static gain: it integrates.")
    if math.isinf(error):
        text = f"The static gain is not known: the data do not determine it ({gain:.4g} is one of many)."
        return _finding("static_gain_unknown", True, text)
    low, high = audit.static_gain_interval
    margin = "" if math.isnan(error) else f" {_interval(gain, low, high)} (95 %)"
    if low <= 0.0 <= high:
        text = f"The static gain is not known from these data: {gain:.4g}{margin}."
        return _finding("static_gain_unknown", True, text)
    if not audit.stable:
        return _finding("static_gain", False, f"{said}, formally, as it is unstable.")
    return _finding("static_gain", False, f"{said}{margin}.")


def _interval(value: float, low: float, high: float) -> str:
    """With ± where both sides are about equal, else as limits with two digits more than their width."""
    down, up = value - low, high - value
    if math.isfinite(up + down) and abs(up - down) <= LOPSIDED * (up + down):
        return f"± {(up + down) / 2:.2g}"
    digits = 4
    if math.isfinite(up + down) and up + down > 0.0:
        digits = min(max(math.ceil(math.log10(max(abs(low), abs(high)) / (up + down))) + 2, 3), 8)
    return f"between {low:.{digits}g} and {high:.{digits}g}"


def _significant(value: float, error: float) -> str:
    """With the digits that the standard error justifies; four where that is unknown."""
    if math.isnan(error) or error <= 0.0 or math.isinf(value) or math.isinf(error) or value == 0.0:
        return f"{value:.4f}" if abs(value) >= 0.01 else f"{value:.4g}"
    digits = math.ceil(math.log10(abs(value) / error)) + 1
    return f"{value:.{min(max(digits, 2), 8)}g}"


def open_findings(
    directions: Sequence[OpenDirection], names: Sequence[str], inputs: Sequence[str]
) -> list[Finding]:
    """Findings on undetermined combinations, each reason once."""
    said = []
    for reason in dict.fromkeys(d.reason for d in directions):
        alike = [d for d in directions if d.reason is reason]
        listed = ", ".join(
            names[i] for i in sorted({i for d in alike for i in d.coefficients}) if i < len(names)
        )
        whose = ", ".join(inputs[i] for i in sorted({i for d in alike for i in d.inputs}) if i < len(inputs))
        whose = f" ({whose})" if whose else ""
        text = f"Not determined by the data: {listed or 'the trend'}, because {reason.value}{whose}."
        said.append(_finding(reason.name.lower(), True, text))
    return said


def feedback_finding(whose: str) -> Finding:
    """For an input that earlier outputs determine."""
    text = (
        f"Not identifiable: {whose} is exactly a function of earlier outputs and of its own past: the loop was "
        "closed without external excitation. Infinitely many models fit equally well; excite the set-point or the "
        "command."
    )
    return _finding("feedback", True, text)


def weak_feedback_finding(whose: str, share: float) -> Finding:
    """For an input that earlier outputs nearly determine."""
    text = (
        f"Hardly identifiable: but for {100 * share:.2g} % of its size {whose} is a function of outputs and of its own "
        "past: the loop was closed, and the only external excitation was as small as a converter's rounding. "
        "Excite the set-point or the command."
    )
    return _finding("feedback_weak", True, text)


def excitation_finding(whose: str, order: int, needed: int) -> Finding:
    """For an input with an order of excitation below the number of coefficients of A and B."""
    what = "one sine excites to order 2" if order == 2 else f"as {order / 2:.3g} sines would"
    if order == 1:
        what = "as a constant input"
    text = (
        f"Poor excitation: {whose} excites to order {order} only ({what}), and A and B have {needed} "
        "coefficients. The model is valid at the frequencies that were excited; its static gain is extrapolated, "
        "not measured."
    )
    return _finding("poor_excitation", True, text)


def trend_finding(model: Armax, unit: str) -> Finding | None:
    """Finding on the terms added to eq. 12; None for none."""
    pairs = zip((model.constant, model.slope), model.trend_errors, strict=True)
    if not any(abs(value) > SURE * sd if math.isfinite(sd) else value for value, sd in pairs):
        return None
    unit, parts = unit if unit != "1" else "", [f"constant {model.constant:.4g} {unit}".rstrip()]
    if model.slope:
        parts.append(f"slope {model.slope:.4g} {unit}/s".replace(" /s", " 1/s"))
    at_one = sum(model.a)
    text = f"Operating point in the model: {', '.join(parts)} on the right side of eq. 12"
    if abs(at_one) > 1e-6 and not model.slope:
        text += (
            f" (the output stands at {model.constant / at_one:.4g} {unit} when the input is zero)".replace(
                " )", ")"
            )
        )
    return _finding("operating_point" if not model.slope else "trend", False, f"{text}.")


def _contents(audit: Audit) -> list[Finding]:
    said = [_static_gain(audit)]
    if audit.only_static:
        rest = 100 * (1 - audit.static_share)
        said.append(
            _finding(
                "only_static",
                True,
                f"It is little more than a static gain: {rest:.2g} % of the impulse response's energy is "
                f"outside its first sample ({audit.first:.4f}), so the recorded output was nearly "
                "proportional to the input.",
            )
        )
    if audit.settles is not None:
        plural = "s" if audit.settles != 1 else ""
        said.append(
            _finding(
                "settles",
                False,
                f"The impulse response has decayed (below 1 %) within {audit.settles} sample{plural}.",
            )
        )
    if audit.time_constants:
        listed = ", ".join(f"{t:.3g}" for t in audit.time_constants)
        said.append(
            _finding("time_constants", False, f"Time constants of the stable poles: {listed} samples.")
        )
    return said


def _residuals(tests: ResidualTests) -> list[Finding]:
    said = []
    rate = f"a correct model fails once in {1 / tests.error_rate:.0f} recordings"
    white = tests.whiteness
    if white.passed:
        said.append(_finding("white", False, f"The residuals are white (p = {white.p_value:.2g}; {rate})."))
    else:
        said.append(
            _finding(
                "not_white",
                True,
                f"The residuals depend on their own past (p = {white.p_value:.2g}; largest correlation "
                f"{white.largest:.3f} at {white.lag} samples; {rate}): the noise model is incomplete.",
            )
        )
    for test in tests.independence:
        if test.passed:
            text = f"The residuals do not depend on {test.name} (p = {test.p_value:.2g}; {rate})."
            said.append(_finding("independent", False, text))
        else:
            said.append(
                _finding(
                    "not_independent",
                    True,
                    f"The residuals depend on {test.name} (p = {test.p_value:.2g}; largest correlation "
                    f"{test.largest:.3f} at {test.lag} samples; {rate}): the model from input to output is incomplete.",
                )
            )
    return said


def _loop(loop: Loop) -> Finding:
    g = loop.gains
    gains = f"Kp = {g.kp:g}, Ki = {g.ki:g}, Kd = {g.kd:g}"
    if loop.stable:
        text = f"{gains} stabilise it; all gains together may be multiplied by up to {loop.largest_factor:.3g} times."
        return _finding("loop_stable", False, text)
    worst = max(loop.poles, key=abs)
    cure = (
        f"below {loop.largest_factor:.2g} times these gains it would be stable"
        if loop.largest_factor > 0
        else "no common scaling of the gains stabilises it"
    )
    return _finding(
        "loop_unstable",
        True,
        f"{gains} do not stabilise it: closed-loop pole {worst.real:.3g}"
        f"{f'±{abs(worst.imag):.3g}i' if worst.imag else ''}, loop gain of the first sample "
        f"{loop.first_sample:.3g}, of Kp alone {loop.first_sample_kp:.3g}; {cure}.",
    )
