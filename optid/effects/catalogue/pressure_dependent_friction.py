"""Seals whose friction grows with the pressure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

SLOPE = Parameter(
    "per_pressure",
    "N/Pa",
    4e-5,
    "dry friction per gauge pressure of each chamber",
    "usual: 0 to 10 N/bar",
    0.0,
    (0.0, 1e-3),
)


class PressureDependentFriction(Effect):
    """F_r + k (P_a - P_atm) + k (P_b - P_atm)."""

    name = "pressure_dependent_friction"
    sites = ("force.coulomb", "flow.pressure_rate_a", "flow.pressure_rate_b")
    equation = "11"
    parameters = (SLOPE,)
    strength = {"per_pressure": 8e-6}
    usual = ({"per_pressure": 4e-5},)
    law = "dry friction is F_r + k (P_a + P_b - 2 P_atm)"
    says = "dry friction grows with the chambers' pressures, by {per_pressure}"
    depends_on = ("pressure_a", "pressure_b", "velocity")
    needs = "motion at chamber pressures that differ widely, best at two supply pressures"
    ahead_of = ("asymmetric_friction", "friction_drift", "position_dependent_friction", "presliding")
    look_alikes = ("friction_drift", "position_dependent_friction", "stribeck_friction", "heat_transfer")
    experiment = "the same strokes at two supply pressures"
    source = "Tran and Yanada, Intelligent Control and Automation 4(2), 2013"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The level of dry friction, N; at the chambers the pressure is only stored."""
        if site != "force.coulomb":
            sheet.store(site, near["P"])
            return nominal
        total = sheet.recall("flow.pressure_rate_a") + sheet.recall("flow.pressure_rate_b")
        return nominal + sheet.param(SLOPE) * (total - 2 * sheet.plant_param("atmospheric_pressure"))
