"""Dry friction that is larger or smaller at some place: a dent, a dry patch, a guide that clamps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

RISE = Parameter(
    "rise", "1", 0.3, "dry friction added at the place, as a share of that far from it",
    "physics catalogue A.1: 5 to 50 %", 0.0, (-0.95, 10.0),
)  # fmt: skip
PLACE = Parameter(
    "place",
    "m",
    0.05,
    "where, from mid-stroke",
    "anywhere along the stroke, or beyond it for a slope",
    0.0,
    (-2.0, 2.0),
)
WIDTH = Parameter(
    "width", "m", 0.03, "distance over which the change dies away", "physics catalogue A.1: 5 to 40 mm, or the stroke",
    0.03, (3e-3, 2.0), logarithmic=True,
)  # fmt: skip
SKEW = Parameter(
    "skew", "1", 0.2, "share by which that distance is longer forwards of the place, and shorter backwards",
    "wear has no reason to be symmetric", 0.0, (-0.9, 0.9),
)  # fmt: skip
EXPONENT = Parameter(
    "exponent",
    "1",
    0.5,
    "exponent of the hill: 1 a peak, 2 a bell, more a plateau",
    "any of them",
    2.0,
    (1.0, 6.0),
)
TOP = 1e-3  # of the width: nearer, a peak is a parabola, whose slopes are finite


class PositionDependentFriction(Effect):
    """F_r (1 + r exp(-|(x - x_0)/w|^n)), with w longer on one side than on the other.

    One hill or hollow of free place and width: narrow for a bump, as wide as the stroke for friction that grows
    towards both ends (a hollow at mid-stroke) or towards one (a hill at that end).
    """

    name = "position_dependent_friction"
    sites = ("force.coulomb",)
    equation = "11"
    parameters = (RISE, PLACE, WIDTH, SKEW, EXPONENT)
    strength = {"rise": 0.05}
    usual = tuple(
        {"rise": rise, "place": place, "width": width, "skew": 0.0, "exponent": 2.0}
        for rise in (0.3, -0.2)
        for place, width in (
            (-0.08, 0.025), (-0.04, 0.025), (0.0, 0.025), (0.04, 0.025), (0.08, 0.025),
            (0.0, 0.08), (-0.1, 0.1), (0.1, 0.1),
        )
    )  # fmt: skip
    law = "dry friction is F_r (1 + r exp(-|(x - x_0) / w|^n))"
    says = (
        "dry friction changes along the stroke by {rise} around {place}, over {width} to either side ({skew} "
        "of it longer forwards; exponent {exponent})"
    )
    depends_on = ("position", "velocity")
    needs = "motion over the whole stroke in both directions"
    look_alikes = (
        "spring_load",
        "sensor_nonlinearity",
        "critical_pressure_ratio",
        "friction_drift",
        "end_cushioning",
    )
    experiment = (
        "pass the place in both directions at two speeds: a spring would help one way, friction hinders both"
    )
    source = "physics catalogue A.1, row 4"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The level of dry friction, N, at the place of the contact."""
        off = near["x"] - sheet.param(PLACE)
        width = sheet.param(WIDTH) * (1 + sheet.param(SKEW) * ca.if_else(off > 0, 1, -1))
        square = (off / width) ** 2
        hill = ca.exp(-square * (square + TOP**2) ** (sheet.param(EXPONENT) / 2 - 1))
        return nominal * (1 + sheet.param(RISE) * hill)
