"""A nonlinear position sensor."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

SIZE = "usual: 0.1 to 1 % of 260 mm"
WITHIN = (-0.05, 0.05)
BOW = Parameter(
    "bow", "m", 3e-4, "error of the even part at mid-stroke; zero at both ends", SIZE, 0.0, WITHIN
)
CURL = Parameter(
    "curl",
    "m",
    3e-4,
    "error of the odd part a quarter of the stroke beyond mid-stroke; zero at both ends",
    SIZE,
    0.0,
    WITHIN,
)
ZERO = Parameter("zero", "m", 1e-3, "constant error: that of the even part at the ends", SIZE, 0.0, WITHIN)
SLOPE = Parameter(
    "slope", "m", 1e-3, "error at the far end of a part that is linear in the position", SIZE, 0.0, WITHIN
)
FINER = (
    2,
    3,
    4,
    5,
    6,
)  # times as many waves along the stroke: a pinion's error has a period of one turn, 63 to 125 mm
BOWS, CURLS = (
    tuple(
        Parameter(
            f"{name}_{k}", "m", 3e-4, f"the same for a finer shape, number {k} of its kind", SIZE, 0.0, WITHIN
        )
        for k in FINER
    )
    for name in ("bow", "curl")
)

SMALLEST = {"zero": 4e-4, "slope": 2e-4} | {
    q.name: 8e-5 for q in (BOW, CURL, *BOWS, *CURLS)
}  # m, worth a name
TRIED = 5.0  # times that


class SensorNonlinearity(Effect):
    """x + zero + slope 2 x / L + sum_k bow_k cos((2 k - 1) pi x / L) + curl_k sin(2 k pi x / L), k = 1..6.

    Any smooth nonlinearity is nearly such a sum; its zero and slope also affect the motion, through the dead volumes.
    """

    name = "sensor_nonlinearity"
    sites = ("sensor.position",)
    equation = "output"
    parameters = (BOW, CURL, ZERO, SLOPE, *BOWS, *CURLS)
    strength = SMALLEST
    usual = tuple(
        dict.fromkeys(SMALLEST, 0.0) | {name: sign * TRIED * least}
        for name, least in SMALLEST.items()
        for sign in (1, -1)
    )
    law = (
        "the measured position is x + zero + slope 2 x / L + sum of bow_k cos((2 k - 1) pi x / L) + curl_k sin(2 "
        "k pi x / L)"
    )
    says = (
        "the position sensor is nonlinear: its error is {bow} at mid-stroke and {curl} a quarter of the stroke "
        "beyond, in finer shapes {bow_2}, {bow_3}, {bow_4}, {bow_5}, {bow_6} (even) and {curl_2}, {curl_3}, "
        "{curl_4}, {curl_5}, {curl_6} (odd), in addition to {zero} everywhere and {slope} more at the far end"
    )
    depends_on = ("position",)
    needs = "motion over most of the stroke"
    look_alikes = ("position_dependent_friction", "spring_load", "sensor_gain", "supply_droop")
    experiment = "gauge blocks, from both sides"
    source = "linearity error of position sensors; eccentric pinions"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The sensor's reading, m."""
        way = near["x"] / near["L"]
        even, odd = sheet.param(ZERO), 2 * sheet.param(SLOPE) * way
        c, s = ca.cos(math.pi * way), ca.sin(math.pi * way)
        c_2, s_2 = (
            c * c - s * s,
            2 * s * c,
        )  # one cosine and one sine, the others by recurrence, because they are expensive
        c_even, s_even = c_2, s_2
        for bow, curl in zip((BOW, *BOWS), (CURL, *CURLS), strict=True):
            even += sheet.param(bow) * (c_even * c + s_even * s)
            odd += sheet.param(curl) * s_even
            c_even, s_even = c_even * c_2 - s_even * s_2, s_even * c_2 + c_even * s_2
        return nominal + even + odd
