"""A spring between the axis and its frame: a cable chain, bellows, a return spring."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

STIFFNESS = Parameter(
    "stiffness", "N/m", 100.0, "stiffness of the spring", "physics catalogue A.1: 20 to 1000 N/m; the air's is 1e4",
    0.0, (0.0, 5e4),
)  # fmt: skip
RELAXED = Parameter(
    "relaxed_position", "m", 0.05, "position at which it does not pull, from mid-stroke",
    "within the stroke, or beyond it for a preload", 0.0, (-2.0, 2.0),
)  # fmt: skip
HARDENING = Parameter(
    "hardening", "1", 0.5, "share by which it pulls harder than Hooke's law has it, 0.1 m from where it does not pull",
    "Duffing's cubic term; a cable chain or bellows stiffens as it is drawn out", 0.0, (0.0, 10.0),
)  # fmt: skip
FAR = 0.1  # m


class SpringLoad(Effect):
    """-k d (1 + h (d / 0.1 m)^2) with d = x - x_0 on the force's side of eq. 11."""

    name = "spring_load"
    sites = ("force.external",)
    equation = "11"
    parameters = (STIFFNESS, RELAXED, HARDENING)
    strength = {"stiffness": 15.0}
    usual = tuple({"stiffness": 150.0, "relaxed_position": x, "hardening": 0.0} for x in (0.0, -0.1, 0.1))
    law = "a force -k d (1 + h (d / 0.1 m)^2) with d = x - x_0"
    says = (
        "a spring of {stiffness} pulls the axis towards {relaxed_position}; 0.1 m from there {hardening} harder than "
        "Hooke's law has it"
    )
    depends_on = ("position",)
    needs = "motion over most of the stroke"
    look_alikes = ("sensor_nonlinearity", "position_dependent_friction", "constant_force", "supply_droop")
    experiment = "hold the axis still at three positions and compare the pressures"
    source = "Duffing's spring; sizes from physics catalogue A.1, row 10"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """External force, N."""
        drawn = near["x"] - sheet.param(RELAXED)
        return nominal - sheet.param(STIFFNESS) * drawn * (1 + sheet.param(HARDENING) * (drawn / FAR) ** 2)
