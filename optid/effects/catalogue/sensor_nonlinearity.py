"""A position sensor whose scale is bent."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

BOW = Parameter(
    "bow", "m", 3e-4, "error at mid-stroke, vanishing at both ends", "physics catalogue A.4: 0.1 to 1 % of 260 mm",
    0.0, (-0.05, 0.05),
)  # fmt: skip
CURL = Parameter(
    "curl", "m", 3e-4, "error a quarter of the stroke beyond mid-stroke, and its opposite a quarter before",
    "physics catalogue A.4: 0.1 to 1 % of 260 mm", 0.0, (-0.05, 0.05),
)  # fmt: skip


class SensorNonlinearity(Effect):
    """x + bow cos(pi x / L) + curl sin(2 pi x / L): the lowest even and odd shapes that leave gain and zero alone."""

    name = "sensor_nonlinearity"
    sites = ("sensor.position",)
    equation = "output"
    parameters = (BOW, CURL)
    strength = {"bow": 8e-5, "curl": 8e-5}
    usual = (
        {"bow": 4e-4, "curl": 0.0}, {"bow": -4e-4, "curl": 0.0},
        {"bow": 0.0, "curl": 4e-4}, {"bow": 0.0, "curl": -4e-4},
    )  # fmt: skip
    law = "shown position is x + bow cos(pi x / L) + curl sin(2 pi x / L)"
    says = "the position sensor is bent: it errs by {bow} at mid-stroke and by {curl} a quarter of the stroke beyond"
    depends_on = ("position",)
    needs = "motion over most of the stroke"
    look_alikes = ("position_dependent_friction", "spring_load", "sensor_gain", "supply_droop")
    experiment = "gauge blocks, from both sides"
    source = "physics catalogue A.4, row 34"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """What the sensor shows, m."""
        turn = math.pi * near["x"] / near["L"]
        return nominal + sheet.param(BOW) * ca.cos(turn) + sheet.param(CURL) * ca.sin(2 * turn)
