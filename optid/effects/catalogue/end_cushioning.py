"""Cushions that throttle the air leaving a chamber over the last part of the stroke."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.core.smooth import soft_power
from optid.effects.effect import Effect

THROTTLING = Parameter(
    "throttling",
    "1",
    20.0,
    "flow area of the fully open valve over that of the cushion's needle",
    "usual: needles of 0.1 to 2 mm2 behind a port of 25 mm2",
    0.0,
    (0.0, 1e3),
)
LENGTH = Parameter(
    "length",
    "m",
    0.02,
    "distance from either end of the stroke at which the cushion begins",
    "usual: 10 to 25 mm",
    0.02,
    (2e-3, 0.1),
)
SIDE = Parameter(
    "side",
    "1",
    1.0,
    "which end's needle throttles: 0 both equally, 1 only the one at the far end, -1 only the other",
    "each end has a needle of its own",
    0.0,
    (-1.0, 1.0),
)
TAPER = Parameter(
    "taper",
    "1",
    5.0,
    "area of the needle where the cushion begins, as a multiple of its smallest",
    "spears are conical so that they enter smoothly",
    0.0,
    (0.0, 100.0),
)
POWER = Parameter(
    "taper_power",
    "1",
    0.5,
    "power of the distance with which it grows: 1 a cone, 2 a rounded spear",
    "both shapes are made",
    1.0,
    (0.5, 3.0),
)
ENTRY = Parameter(
    "entry",
    "m",
    1e-3,
    "distance over which the spear closes the bore",
    "its chamfer: a sharp edge to a few millimetres",
    2e-3,
    (1e-4, 5e-3),
    logarithmic=True,
)
ONE_END = 0.5  # of the side: beyond it one end throttles at least twice as much as the other
SHUT = 1e-3  # of the length: nearer the end the power law is replaced by a line


class EndCushioning(Effect):
    """Valve and needle in series, 1/A^2 = 1/A_valve^2 + 1/A_needle^2, near the end towards which a chamber shrinks.

    The check valve lets air into the chamber as before.
    """

    name = "end_cushioning"
    sites = ("flow.exhaust_area",)
    equation = "1, 2"
    parameters = (THROTTLING, LENGTH, SIDE, TAPER, POWER, ENTRY)
    strength = {"throttling": 2.0}
    usual = tuple(
        {
            "throttling": throttling,
            "length": length,
            "side": side,
            "taper": taper,
            "taper_power": 1.0,
            "entry": 2e-3,
        }
        for throttling, length, taper in (
            (20.0, 0.01, 0.0),
            (20.0, 0.018, 0.0),
            (20.0, 0.028, 5.0),
            (100.0, 0.012, 0.0),
        )
        for side in (0.0, 1.0, -1.0)
    )
    law = (
        "near an end the shrinking chamber vents through both: 1/A^2 = 1/A_valve^2 + (throttling / A_full)^2; the "
        "needle's area grows with the distance from the end, by the taper where the cushion begins"
    )
    says = (
        "cushions throttle the outflow over the last {length}, to a needle {throttling} times smaller than the "
        "open valve (side {side}: 0 both ends, 1 the far one, -1 the near one; {taper} times wider where it begins, "
        "by the power {taper_power} of the distance; it enters over {entry})"
    )
    depends_on = ("position", "flow")
    places = ("position",)
    needs = "motion into the last 10 to 25 mm before an end of the stroke"
    look_alikes = ("exhaust_restriction", "position_dependent_friction", "tube_restriction")
    experiment = "strokes to both ends with the cushions' needles turned"
    source = "check valve and needle of a cushioned cylinder"

    def active_range(
        self, values: Mapping[str, float], plant: Mapping[str, float]
    ) -> Mapping[str, tuple[float, float]]:
        """The end that is cushioned, if it is one of them."""
        half, inner = plant["stroke"] / 2, plant["stroke"] / 2 - values["length"]
        if abs(values["side"]) <= ONE_END:
            return {}
        return {"position": (inner, half) if values["side"] > 0.0 else (-half, -inner)}

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """Venting area, m2."""
        s, x, half = near["spool"], near["x"], sheet.plant_param("stroke") / 2
        distance = ca.if_else(s > 0, half - x, half + x)
        inside = ca.fmin(ca.fmax((sheet.param(LENGTH) - distance) / sheet.param(ENTRY), 0), 1)
        share = inside**2 * (3 - 2 * inside)
        # The side reduces the throttling of the opposite end only.
        side = sheet.param(SIDE)
        share *= 1 - ca.fmax(ca.if_else(s > 0, -side, side), 0)
        full = sheet.plant_param("port_width") * sheet.plant_param("spool_travel")
        free = soft_power(ca.fmin(ca.fmax(distance / sheet.param(LENGTH), 0), 1), sheet.param(POWER), SHUT)
        wider = 1 + sheet.param(TAPER) * free
        return nominal / ca.sqrt(1 + (sheet.param(THROTTLING) * share * nominal / (full * wider)) ** 2)
