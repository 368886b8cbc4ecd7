"""A position sensor whose scale is bent."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

SIZE = "physics catalogue A.4: 0.1 to 1 % of 260 mm"
WITHIN = (-0.05, 0.05)
BOW = Parameter(
    "bow", "m", 3e-4, "error at mid-stroke of the even part, nothing at both ends", SIZE, 0.0, WITHIN
)
CURL = Parameter(
    "curl", "m", 3e-4, "error a quarter of the stroke beyond mid-stroke of the odd part, nothing at both ends", SIZE,
    0.0, WITHIN,
)  # fmt: skip
ZERO = Parameter("zero", "m", 1e-3, "error everywhere: what the even part has at the ends", SIZE, 0.0, WITHIN)
SLOPE = Parameter(
    "slope", "m", 1e-3, "error at the far end of one that grows with the way", SIZE, 0.0, WITHIN
)


class SensorNonlinearity(Effect):
    """x + zero + slope 2 x / L + bow cos(pi x / L) + curl sin(2 pi x / L): lowest even and odd shapes.

    Any smooth bend is nearly such a sum; its zero and slope show in the motion as well, through the dead volumes.
    """

    name = "sensor_nonlinearity"
    sites = ("sensor.position",)
    equation = "output"
    parameters = (BOW, CURL, ZERO, SLOPE)
    strength = {"bow": 8e-5, "curl": 8e-5, "zero": 4e-4, "slope": 2e-4}
    usual = tuple(
        {"bow": 0.0, "curl": 0.0, "zero": 0.0, "slope": 0.0, name: sign * size}
        for name, size in (("bow", 4e-4), ("curl", 4e-4), ("zero", 1e-3), ("slope", 1e-3))
        for sign in (1, -1)
    )
    law = "shown position is x + zero + slope 2 x / L + bow cos(pi x / L) + curl sin(2 pi x / L)"
    says = (
        "the position sensor is bent: it errs by {bow} at mid-stroke and by {curl} a quarter of the stroke beyond, "
        "apart from {zero} everywhere and {slope} more at the far end"
    )
    depends_on = ("position",)
    needs = "motion over most of the stroke"
    look_alikes = ("position_dependent_friction", "spring_load", "sensor_gain", "supply_droop")
    experiment = "gauge blocks, from both sides"
    source = "physics catalogue A.4, row 34"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """What the sensor shows, m."""
        way = near["x"] / near["L"]
        even = sheet.param(ZERO) + sheet.param(BOW) * ca.cos(math.pi * way)
        odd = 2 * sheet.param(SLOPE) * way + sheet.param(CURL) * ca.sin(2 * math.pi * way)
        return nominal + even + odd
