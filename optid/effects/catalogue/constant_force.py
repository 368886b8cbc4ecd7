"""A force that is always there: tilt, a weight, a hose that pulls."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

FORCE = Parameter(
    "force",
    "N",
    5.0,
    "constant force towards positive position",
    "usual: 1 to 30 N",
    0.0,
    (-2e3, 2e3),
)


class ConstantForce(Effect):
    """A constant on the force's side of eq. 11; M g sin(angle) for an axis out of level."""

    name = "constant_force"
    sites = ("force.external",)
    equation = "11"
    parameters = (FORCE,)
    strength = {"force": 1.0}
    usual = ({"force": 5.0}, {"force": -5.0})
    law = "a constant force F_0 added to those of the air and of friction"
    says = "a constant force of {force} pushes towards positive position, as a tilt or a hanging weight would"
    depends_on = ("position", "pressure_a", "pressure_b")
    needs = "motion in both directions, or rests at known pressures"
    look_alikes = ("asymmetric_friction", "pressure_sensor_offset", "spring_load", "valve_offset")
    shares = {"force": "asymmetric_friction"}  # dry friction alone, stronger one way
    experiment = "turn the axis over, or change the payload: weight grows with it, friction does not"
    source = "Newton's second law along a tilted axis"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """External force, N."""
        return nominal + sheet.param(FORCE)
