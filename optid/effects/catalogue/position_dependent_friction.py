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


class PositionDependentFriction(Effect):
    """F_r (1 + r exp(-((x - x_0)/w)^2)).

    One hill or hollow of free place and width: narrow for a bump, as wide as the stroke for friction that grows
    towards both ends (a hollow at mid-stroke) or towards one (a hill at that end).
    """

    name = "position_dependent_friction"
    sites = ("force.coulomb",)
    equation = "11"
    parameters = (RISE, PLACE, WIDTH)
    strength = {"rise": 0.05}
    usual = tuple(
        {"rise": rise, "place": place, "width": width}
        for rise in (0.3, -0.2)
        for place, width in (
            (-0.08, 0.025), (-0.04, 0.025), (0.0, 0.025), (0.04, 0.025), (0.08, 0.025),
            (0.0, 0.08), (-0.1, 0.1), (0.1, 0.1),
        )
    )  # fmt: skip
    law = "dry friction is F_r (1 + r exp(-((x - x_0) / w)^2))"
    says = "dry friction changes along the stroke by {rise} around {place}, over {width} to either side"
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
        hill = ca.exp(-(((near["x"] - sheet.param(PLACE)) / sheet.param(WIDTH)) ** 2))
        return nominal * (1 + sheet.param(RISE) * hill)
