"""Dry friction that builds up over a distance: seals that deform before they slide."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.core.smooth import dead_zone
from optid.effects.effect import Effect
from optid.effects.parallel_elements import shares

DISTANCE = Parameter(
    "distance",
    "m",
    1e-4,
    "mean elastic motion before dry friction slips, where longer than presliding_length",
    "usual: 0.1 to 8 mm for rubber seals",
    0.0,
    (0.0, 8e-3),
)
SPREAD = Parameter(
    "spread",
    "1",
    0.3,
    "how much earlier the first part of the seal slips and how much later the last, as a share of "
    "the distance",
    "lips and backs of seals let go one after the other (Iwan, J. Applied Mechanics 33, 1966)",
    0.0,
    (0.0, 0.95),
)
DAMPING = Parameter(
    "micro_damping",
    "N s/m",
    200.0,
    "damping of that elastic motion",
    "usual: 50 to 1000 N s/m",
    200.0,
    (0.0, 3e3),
)
BEND = Parameter(
    "bend",
    "1",
    0.05,
    "by how much the last part holds longer than in an even spread, as a share of the distance",
    "lengths are positive, so their distribution is skewed to the long ones",
    0.0,
    (0.0, 0.5),
)
CATCH = 3e-4  # s: time constant of the deflection of a slipping part; the force is exact at any value


class Presliding(Effect):
    """Six elastic parts in parallel instead of the plant's bristle, each a sixth of the friction, with its own length.

    Each is a spring until it slips at constant force (Iwan's elements): after a reversal it is elastic again, and the
    memory of large motions is kept during small ones (Masing's rule). Sticking parts are damped, slipping ones are not.
    """

    name = "presliding"
    sites = ("force.presliding", "force.coulomb", "force.friction")
    equation = "11"
    parameters = (DISTANCE, SPREAD, BEND, DAMPING)
    strength = {"distance": 4e-5}
    usual = tuple(
        {"distance": d, "spread": spread, "bend": 0.0, "micro_damping": 200.0}
        for d in (1e-4, 3e-4, 1e-3)
        for spread in (0.0, 0.6)
    )
    law = (
        "dry friction builds up over six distances d_k from d (1 - s) to d (1 + s), bent: z_k' = v while |z_k| < d_k, "
        "F = F_r mean(z_k / d_k) + sigma_1 mean(z_k')"
    )
    says = (
        "the axis yields elastically over {distance} before it slides; parts of the seal slip earlier or later "
        "by up to {spread} of that (the last by {bend} more); damping {micro_damping}"
    )
    depends_on = ("velocity",)
    needs = "reversals and starts from rest, best of 0.1 to 1 mm amplitude"
    look_alikes = ("sensor_backlash", "stribeck_friction", "compliant_load", "valve_deadband")
    experiment = (
        "reversals of 0.1 to 1 mm: friction forms a hysteresis loop; an encoder on the rod excludes backlash"
    )
    source = (
        "Canudas de Wit, Olsson, Astrom and Lischinsky, IEEE Trans. Automatic Control 40(3), 1995; Iwan, Journal of "
        "Applied Mechanics 33, 1966"
    )

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The bristle's length, m; dry friction, N; friction force, N."""
        if site == "force.presliding":
            self._bend(nominal, near, sheet)
            return nominal
        if site == "force.coulomb":
            sheet.store("level", nominal)
            return nominal
        return (
            nominal
            + sheet.recall("level") * sheet.recall("apart")
            + sheet.param(DAMPING) * sheet.recall("speed")
        )

    def _bend(self, length: Any, near: Mapping[str, Any], sheet: Sheet) -> None:
        """Store the parts' mean share minus the plant's own bristle, and the mean deflection rate, m/s."""
        v, most, distance = near["v"], near["most"], sheet.param(DISTANCE)
        spread, bend = sheet.param(SPREAD), sheet.param(BEND)
        mean, speed = ca.SX(0), ca.SX(0)
        parts = shares(spread, bend)
        for number, share in enumerate(parts, 1):
            own = ca.fmax(length, share * distance)
            deflection = sheet.state(f"part_{number}", "m", 1e-4, spread=1e-4)
            beyond = dead_zone(deflection, most * own)
            sheet.rate(deflection, v - beyond / CATCH)
            mean = mean + (deflection - beyond) / own / len(parts)
            speed = speed + ca.if_else(beyond == 0, v, 0) / len(parts)
        counts = ca.fmin(1, distance / length)  # ones shorter than the plant's own count less
        sheet.store("apart", (mean - near["z"]) * counts)
        sheet.store("speed", speed * counts)
