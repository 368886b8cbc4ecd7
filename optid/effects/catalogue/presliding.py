"""Dry friction that builds up over a distance: seals that bend before they slide."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

DISTANCE = Parameter(
    "distance", "m", 1e-4, "mean elastic motion before dry friction slips, where longer than presliding_length",
    "physics catalogue A.1: 0.1 to 8 mm for rubber seals", 0.0, (0.0, 8e-3),
)  # fmt: skip
SPREAD = Parameter(
    "spread", "1", 0.3, "how much earlier the first part of the seal slips and how much later the last, as a share of "
    "the distance", "lips and backs of seals let go one after the other (Iwan, J. Applied Mechanics 33, 1966)",
    0.0, (0.0, 0.95),
)  # fmt: skip
DAMPING = Parameter(
    "micro_damping", "N s/m", 200.0, "damping of that elastic motion", "physics catalogue A.1: 50 to 1000 N s/m",
    200.0, (0.0, 3e3),
)  # fmt: skip
PARTS = {
    "first": -1.0,
    "second": -1 / 3,
    "third": 1 / 3,
    "last": 1.0,
}  # of the spread: how much longer than the mean
BEYOND = 1.5  # of a deflection squared, over what slips: where that falls faster the bristle follows at a steady pace
ABRUPT = 2.0  # times the plant's lag in which a bristle builds up at speed: an abrupt one is stiffer


class Presliding(Effect):
    """Four bristles in parallel instead of the plant's own, each a quarter of the friction and longer than the last.

    With z_k their deflections over their lengths d_k: F = F_r mean(z_k) + sigma_1 mean(d_k z_k'). Each is nearly
    elastic until it slips, and elastic again when the motion turns (Bouc and Wen's law with beta = gamma, n = 8): one
    bristle forgets a reversal within a larger one, which real seals remember (Masing's rule); several do not.
    """

    name = "presliding"
    sites = ("force.presliding", "force.coulomb", "force.friction")
    equation = "11"
    parameters = (DISTANCE, SPREAD, DAMPING)
    strength = {"distance": 4e-5}
    usual = tuple(
        {"distance": d, "spread": spread, "micro_damping": 200.0}
        for d in (1e-4, 3e-4, 1e-3)
        for spread in (0.0, 0.6)
    )
    law = (
        "dry friction builds up over four distances d_k from d (1 - s) to d (1 + s): z_k' = v / d_k until z_k is 1, "
        "F = F_r mean(z_k) + sigma_1 mean(d_k z_k')"
    )
    says = (
        "the axis gives elastically over {distance} before it slides, one part of the seal {spread} of that earlier "
        "and another later, damped by {micro_damping}"
    )
    depends_on = ("velocity",)
    needs = "reversals and starts from rest, best of 0.1 to 1 mm amplitude"
    look_alikes = ("sensor_backlash", "stribeck_friction", "compliant_load", "valve_deadband")
    experiment = (
        "reversals of 0.1 to 1 mm: friction runs round a loop; an encoder on the rod excludes backlash"
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
            sheet.note("level", nominal)
            return nominal
        return (
            nominal
            + sheet.noted("level") * sheet.noted("apart")
            + sheet.param(DAMPING) * sheet.noted("speed")
        )

    def _bend(self, length: Any, near: Mapping[str, Any], sheet: Sheet) -> None:
        """Note how far the mean deflection is from the plant's own bristle's, and the mean speed of bending, m/s."""
        v, most, distance = near["v"], near["most"], sheet.param(DISTANCE)
        lag = ABRUPT * sheet.plant_param("bristle_lag")
        mean, speed = ca.SX(0), ca.SX(0)
        for name, side in PARTS.items():
            z, own = sheet.state(name, "1", 1.0, spread=1.0), (1 + side * sheet.param(SPREAD)) * distance
            squared = ca.fmin((z / most) ** 2, BEYOND)
            reach = ca.sqrt(ca.fmax(length, own) ** 2 + (lag * v) ** 2)
            rate = (v - ((squared**2) ** 2) * (v + ca.fabs(v) * ca.sign(z)) / 2) / reach
            sheet.rate(z, rate)
            mean, speed = mean + z / len(PARTS), speed + own * rate / len(PARTS)
        # Where they are shorter than the plant's own they count the less, and at nothing not at all.
        sheet.note("apart", (mean - near["z"]) * ca.fmin(1, distance / length))
        sheet.note("speed", speed)
