"""An audit in sentences."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from optid.armax.loop import Loop
from optid.armax.residuals import ResidualTests

if TYPE_CHECKING:
    from optid.armax.audit import Audit, Finding


SURE = 3.0  # standard errors within which a pole may be an integrator's
SLOW = 1e-3  # a pole so little outside 1 needs a thousand samples to grow by e


def findings(audit: Audit) -> tuple[Finding, ...]:
    """All that is worth saying, grave things first."""
    said = [*_stability(audit), *_cancelled(audit), *_contents(audit)]
    if audit.residuals is not None:
        said += _residuals(audit.residuals)
    if audit.loop is not None:
        said.append(_loop(audit.loop))
    return tuple(sorted(said, key=lambda finding: not finding.grave))


def number(root: complex) -> str:
    """A root as people write it."""
    return f"{root.real:.4f}±{root.imag:.4f}i" if root.imag else f"{root.real:.4f}"


def _finding(name: str, grave: bool, text: str) -> Finding:
    from optid.armax.audit import Finding

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
        text = f"A pole at {outside[0].real:.4f}{margin}: as far as the data tell, it integrates."
        return [_finding("integrating", False, text)]
    tests = audit.residuals
    coloured = tests is not None and not (tests.white and tests.independent)
    if len(outside) == 1 and not outside[0].imag and abs(outside[0] - 1.0) <= SLOW and coloured:
        text = (
            f"A pole at {outside[0].real:.4f}: an integrator's, or one that grows slowly. The data do not tell, "
            "because with these residuals its standard error is too small."
        )
        return [_finding("integrating", False, text)]
    listed = ", ".join(number(p) for p in outside)
    return [
        _finding("unstable", True, f"Unstable as written: pole {listed} lies on or outside the unit circle.")
    ]


def _margin(sd: float) -> float:
    return 1e-9 if math.isnan(sd) else max(1e-9, SURE * sd)


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
        text = f"Written with order {audit.order}, effectively of order {audit.effective_order}."
        said.append(_finding("effective_order", True, text))
    return said


def _contents(audit: Audit) -> list[Finding]:
    said = []
    gain = f"Static gain {audit.static_gain:.4f}"
    if math.isinf(audit.static_gain) or _stability(audit)[0].name == "integrating":
        gain = "No static gain: it integrates"
    elif not audit.stable:
        gain += ", formally, as it is unstable"
    said.append(_finding("static_gain", False, f"{gain}."))
    if audit.only_static:
        rest = 100 * (1 - audit.static_share)
        said.append(
            _finding(
                "only_static",
                True,
                f"It holds hardly more than a static gain: {rest:.2g} % of the impulse response's energy is "
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
                f"All that answers an impulse is over (below 1 %) within {audit.settles} sample{plural}.",
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
    rate = f"a right model fails once in {1 / tests.error_rate:.0f} recordings"
    white = tests.whiteness
    if white.passed:
        said.append(_finding("white", False, f"The residuals are white (p = {white.p_value:.2g}; {rate})."))
    else:
        said.append(
            _finding(
                "not_white",
                True,
                f"The residuals depend on their own past (p = {white.p_value:.2g}; largest correlation "
                f"{white.largest:.3f} at {white.lag} samples; {rate}): the noise model lacks something.",
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
                    f"{test.largest:.3f} at {test.lag} samples; {rate}): the model from input to output "
                    "lacks something.",
                )
            )
    return said


def _loop(loop: Loop) -> Finding:
    g = loop.gains
    gains = f"Kp = {g.kp:g}, Ki = {g.ki:g}, Kd = {g.kd:g}"
    if loop.stable:
        text = f"{gains} stabilise it; all gains together may grow {loop.largest_factor:.3g} times."
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
