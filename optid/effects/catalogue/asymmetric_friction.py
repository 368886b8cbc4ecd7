"""Friction that differs between the two directions of motion."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

DRY = Parameter(
    "dry_asymmetry",
    "1",
    0.1,
    "(dry friction forwards - backwards) over their sum",
    "usual: 2 to 20 %",
    0.0,
    (-0.95, 0.95),
)
VISCOUS = Parameter(
    "viscous_asymmetry",
    "1",
    0.1,
    "(viscous friction forwards - backwards) over their sum",
    "EMPS benchmark, separate fit: 18 %",
    0.0,
    (-0.95, 0.95),
)


class AsymmetricFriction(Effect):
    """Dry friction F_r (1 + a sign v) and viscous friction K_f (1 + b sign v)."""

    name = "asymmetric_friction"
    sites = ("force.viscous", "force.coulomb")
    equation = "11"
    parameters = (DRY, VISCOUS)
    strength = {"dry_asymmetry": 0.02, "viscous_asymmetry": 0.03}
    usual = (
        {"dry_asymmetry": 0.1, "viscous_asymmetry": 0.0},
        {"dry_asymmetry": -0.1, "viscous_asymmetry": 0.0},
        {"dry_asymmetry": 0.0, "viscous_asymmetry": 0.2},
        {"dry_asymmetry": 0.0, "viscous_asymmetry": -0.2},
    )
    law = "F_r (1 + a) and K_f (1 + b) forwards, F_r (1 - a) and K_f (1 - b) backwards"
    says = (
        "friction forwards differs from friction backwards: dry friction by {dry_asymmetry} and viscous friction "
        "by {viscous_asymmetry} of the mean either way"
    )
    depends_on = ("velocity",)
    needs = "motion in both directions"
    ahead_of = ("presliding",)
    look_alikes = ("constant_force", "stribeck_friction", "valve_asymmetry", "pressure_sensor_offset")
    shares = {"dry_asymmetry": "constant_force"}  # F_r (1 + a sign v) sign v = F_r sign v + a F_r
    experiment = (
        "measure the force that just starts motion, both ways; a constant force acts on an axis at rest too"
    )
    source = "Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30(7), 1994, section 2"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """Viscous friction at speed v, N; the level of dry friction, N, in the direction in which it acts."""
        if site == "force.viscous":
            return nominal * (1 + sheet.param(VISCOUS) * ca.sign(near["v"]))
        return nominal * (1 + sheet.param(DRY) * ca.sign(near["share"]))
