"""A spring between the axis and its frame: a cable chain, bellows, a return spring."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

STIFFNESS = Parameter(
    "stiffness",
    "N/m",
    100.0,
    "stiffness of the spring",
    "usual: 20 to 1000 N/m; the air's is 1e4",
    0.0,
    (0.0, 5e4),
)
RELAXED = Parameter(
    "relaxed_position",
    "m",
    0.05,
    "position at which the spring is relaxed, from mid-stroke",
    "within the stroke, or beyond it for a preload",
    0.0,
    (-2.0, 2.0),
)
HARDENING = Parameter(
    "hardening",
    "1",
    0.5,
    "share by which it is stronger than Hooke's law, 0.1 m from the relaxed position",
    "Duffing's cubic term; a cable chain or a bellows stiffens as it is extended",
    0.0,
    (0.0, 10.0),
)
STEEPENING = Parameter(
    "steepening",
    "1",
    0.03,
    "the same share for the term of the fourth power of the distance",
    "a fully extended chain or bellows pulls harder and harder",
    0.0,
    (0.0, 0.1),
)
FAR = 0.1  # m
# Square of the distance in FAR, beyond which the cube alone counts: it would be stiffer than steel.
FARTHEST = 4.0


class SpringLoad(Effect):
    """-k d (1 + h r^2 + s r^4) with d = x - x_0 and r = d / 0.1 m, up to 0.2 m, on the force's side of eq. 11."""

    name = "spring_load"
    sites = ("force.external",)
    equation = "11"
    parameters = (STIFFNESS, RELAXED, HARDENING, STEEPENING)
    strength = {"stiffness": 15.0}
    usual = tuple(
        {"stiffness": 150.0, "relaxed_position": x, "hardening": 0.0, "steepening": 0.0}
        for x in (0.0, -0.1, 0.1)
    )
    law = "a force -k d (1 + h r^2 + s r^4) with d = x - x_0 and r = d / 0.1 m"
    says = (
        "a spring of {stiffness} pulls the axis towards {relaxed_position}; 0.1 m from there it is {hardening} "
        "stronger than Hooke's law, and {steepening} more by the fourth power of the distance"
    )
    depends_on = ("position",)
    needs = "motion over most of the stroke"
    look_alikes = ("sensor_nonlinearity", "position_dependent_friction", "constant_force", "supply_droop")
    experiment = "hold the axis still at three positions and compare the pressures"
    source = "Duffing's spring"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """External force, N."""
        drawn = near["x"] - sheet.param(RELAXED)
        square = (drawn / sheet.length(FAR)) ** 2
        harder = square * (sheet.param(HARDENING) + sheet.param(STEEPENING) * ca.fmin(square, FARTHEST))
        return nominal - sheet.param(STIFFNESS) * drawn * (1 + harder)
