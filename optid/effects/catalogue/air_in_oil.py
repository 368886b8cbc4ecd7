"""Bubbles of undissolved air: the oil is soft at low pressure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

CONTENT = Parameter(
    "content",
    "1",
    0.01,
    "undissolved air at 1 bar, beyond the plant's own, as a share of the volume",
    "Jelali and Kroll, 2003, section 3.2: 0.5 to 5 %",
    0.0,
    (0.0, 0.3),
)
EXPONENT = Parameter(
    "exponent",
    "1",
    0.2,
    "polytropic exponent of the bubbles: 1 slow, 1.4 fast",
    "Jelali and Kroll, 2003, section 3.2",
    1.3,
    (1.0, 1.4),
)
REFERENCE, VACUUM = 1e5, 1e3  # Pa: where the content is stated, and the least pressure


class AirInOil(Effect):
    """Adds a (p_0 / p)^(1/n) / (n p) to the compressibility 1/E."""

    name = "air_in_oil"
    sites = ("flow.compressibility",)
    equation = "chamber balance"
    parameters = (CONTENT, EXPONENT)
    strength = {"content": 1e-3}
    usual = ({"content": 5e-3, "exponent": 1.3}, {"content": 0.03, "exponent": 1.3})
    law = "1/E grows by a (p_0 / p)^(1/n) / (n p), p_0 = 1 bar"
    says = "the oil holds {content} more air by volume at 1 bar (exponent {exponent})"
    depends_on = ("pressure_a", "pressure_b")
    needs = "quick changes of pressure at low and at high pressure"
    look_alikes = ("valve_lag", "compliant_load", "laminar_leakage")
    experiment = "compress a closed chamber in steps: with air it is soft at first and stiff later"
    source = "Jelali and Kroll, Hydraulic Servo-systems, 2003, section 3.2"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """Compressibility, 1/Pa."""
        n, P = sheet.param(EXPONENT), ca.fmax(near["P"], VACUUM)
        return nominal + sheet.param(CONTENT) * ca.exp(-ca.log(P / REFERENCE) / n) / (n * P)
