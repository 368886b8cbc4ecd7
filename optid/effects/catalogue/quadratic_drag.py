"""Resistance that grows with the square of speed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

DRAG = Parameter(
    "drag",
    "N s**2/m**2",
    40.0,
    "force per speed squared",
    "usual: 10 to 100 N s2/m2",
    0.0,
    (0.0, 2e3),
)
EXPONENT = Parameter(
    "exponent",
    "1",
    0.3,
    "power of the speed with which it grows",
    "2 around a body, 1.75 along a smooth wall (Blasius)",
    2.0,
    (1.5, 3.0),
)
SLOW = 1e-2  # m/s: below, a power other than 2 is smooth


class QuadraticDrag(Effect):
    """c v |v|^(n - 1), with speeds in m/s, in addition to eq. 11's friction; n is about 2."""

    name = "quadratic_drag"
    sites = ("force.friction",)
    equation = "11"
    parameters = (DRAG, EXPONENT)
    strength = {"drag": 6.0}
    usual = ({"drag": 40.0, "exponent": 2.0},)
    law = "a resistance c v |v|^(n - 1), n about 2"
    says = "a drag grows about with the square of the speed; it is {drag} at 1 m/s (exponent {exponent})"
    depends_on = ("velocity",)
    needs = "speeds above 0.5 m/s as well as slow ones"
    look_alikes = ("stribeck_friction", "supply_droop", "tube_restriction", "exhaust_restriction")
    experiment = "strokes at 0.2, 0.5 and 1 m/s with the pressures measured"
    source = "turbulent flow around a body"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """Friction force, N."""
        v, one = near["v"], sheet.length(1.0)
        more = ((v / one) ** 2 + SLOW**2) ** (sheet.param(EXPONENT) / 2 - 1)
        return nominal + sheet.param(DRAG) * v * ca.fabs(v) * more
