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
    "physics catalogue A.1: 10 to 100 N s2/m2",
    0.0,
    (0.0, 2e3),
)


class QuadraticDrag(Effect):
    """c v |v| beside eq. 11's friction."""

    name = "quadratic_drag"
    sites = ("force.friction",)
    equation = "11"
    parameters = (DRAG,)
    strength = {"drag": 6.0}
    usual = ({"drag": 40.0},)
    law = "a resistance c v |v|"
    says = "resistance grows with the square of speed, by {drag}"
    depends_on = ("velocity",)
    needs = "speeds of half a metre per second and more beside slow ones"
    look_alikes = ("stribeck_friction", "supply_droop", "tube_restriction", "exhaust_restriction")
    experiment = "strokes at 0.2, 0.5 and 1 m/s with the pressures measured"
    source = "turbulent flow around a body; sizes from physics catalogue A.1, row 5"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """Friction force, N."""
        return nominal + sheet.param(DRAG) * near["v"] * ca.fabs(near["v"])
