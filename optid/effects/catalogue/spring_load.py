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


class SpringLoad(Effect):
    """-k (x - x_0) on the force's side of eq. 11."""

    name = "spring_load"
    sites = ("force.external",)
    equation = "11"
    parameters = (STIFFNESS, RELAXED)
    strength = {"stiffness": 15.0}
    usual = tuple({"stiffness": 150.0, "relaxed_position": x} for x in (0.0, -0.1, 0.1))
    law = "a force -k (x - x_0)"
    says = "a spring of {stiffness} pulls the axis towards {relaxed_position}"
    depends_on = ("position",)
    needs = "motion over most of the stroke"
    look_alikes = ("sensor_nonlinearity", "position_dependent_friction", "constant_force", "supply_droop")
    experiment = "hold the axis still at three positions and compare the pressures"
    source = "Hooke's law; sizes from physics catalogue A.1, row 10"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """External force, N."""
        return nominal - sheet.param(STIFFNESS) * (near["x"] - sheet.param(RELAXED))
