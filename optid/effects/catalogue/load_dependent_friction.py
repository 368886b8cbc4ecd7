"""Gears and guides whose friction grows with the transmitted load."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

SHARE = Parameter(
    "share",
    "1",
    0.1,
    "dry friction per force or torque transmitted through the contact",
    "gear stages lose 1 to 10 % each, worms and screws up to half",
    0.0,
    (0.0, 2.0),
)
SMOOTH = 1e-3  # of the site's usual size: rounding of the magnitude's corner


class LoadDependentFriction(Effect):
    """F_r + k |F_drive|: the level of dry friction, increased by the transmitted load."""

    name = "load_dependent_friction"
    sites = ("force.coulomb",)
    equation = "11"
    parameters = (SHARE,)
    strength = {"share": 0.01}
    usual = ({"share": 0.1},)
    law = "dry friction is F_r + k |F_drive|"
    says = "dry friction grows with the transmitted force or torque, by {share} of it"
    depends_on = ("velocity",)
    needs = "motion under loads that differ widely"
    ahead_of = ("asymmetric_friction", "friction_drift", "position_dependent_friction", "presliding")
    look_alikes = ("stribeck_friction", "quadratic_drag", "position_dependent_friction")
    experiment = "the same motion with two weights on the arm"
    source = "Dohring, Lee and Newman, American Control Conference 1993; friction of loaded gears"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The level of dry friction, N or N m; the plant names the transmitted load "drive"."""
        small = SMOOTH * near["size"]
        return nominal + sheet.param(SHARE) * (ca.sqrt(near["drive"] ** 2 + small**2) - small)
