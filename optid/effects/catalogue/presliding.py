"""Dry friction that builds up over a distance: seals that bend before they slide."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

DISTANCE = Parameter(
    "distance", "m", 1e-4, "elastic motion before dry friction slips, where longer than presliding_length",
    "physics catalogue A.1: 0.1 to 8 mm for rubber seals", 0.0, (0.0, 8e-3),
)  # fmt: skip
DAMPING = Parameter(
    "micro_damping", "N s/m", 200.0, "damping of that elastic motion", "physics catalogue A.1: 50 to 1000 N s/m",
    200.0, (0.0, 3e3),
)  # fmt: skip


class Presliding(Effect):
    """The LuGre law: the bristle is `distance` long if the plant's is shorter, and its deflection damped viscously.

    With z the deflection over its length d: F = F_r z + sigma_1 d z', in place of F_r z over the short length which
    the plant has for dry friction to be smooth, and which a fit may move.
    """

    name = "presliding"
    sites = ("force.presliding", "force.friction")
    equation = "11"
    parameters = (DISTANCE, DAMPING)
    strength = {"distance": 4e-5}
    usual = tuple({"distance": d, "micro_damping": 200.0} for d in (1e-4, 3e-4, 1e-3))
    law = "dry friction builds up over a distance d: z' = (v - |v| z) / d, F = F_r z + sigma_1 d z'"
    says = "the axis gives elastically over {distance} before it slides, damped by {micro_damping}"
    depends_on = ("velocity",)
    needs = "reversals and starts from rest, best of 0.1 to 1 mm amplitude"
    look_alikes = ("sensor_backlash", "stribeck_friction", "compliant_load", "valve_deadband")
    experiment = (
        "reversals of 0.1 to 1 mm: friction runs round a loop; an encoder on the rod excludes backlash"
    )
    source = "Canudas de Wit, Olsson, Astrom and Lischinsky, IEEE Trans. Automatic Control 40(3), 1995"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The bristle's length, m; friction force, N."""
        distance = sheet.param(DISTANCE)
        if site == "force.presliding":
            sheet.note("length", ca.fmax(nominal, distance))
            sheet.note("z", near["z"])
            sheet.note("most", near["most"])
            return sheet.noted("length")
        v, length, z = near["v"], sheet.noted("length"), sheet.noted("z")
        reach = ca.sqrt(length**2 + (sheet.plant_param("bristle_lag") * v) ** 2)
        rate = (v - ca.fabs(v) * z / sheet.noted("most")) / reach
        return nominal + sheet.param(DAMPING) * distance * rate
