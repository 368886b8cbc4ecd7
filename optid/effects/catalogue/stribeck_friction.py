"""Dry friction that is larger at rest than in motion."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

RATIO = Parameter(
    "breakaway_ratio",
    "1",
    0.3,
    "dry friction at rest over dry friction in motion",
    "usual: 5 to 60 N on top of 80 N",
    1.0,
    (1.0, 5.0),
)
SPEED = Parameter(
    "stribeck_speed",
    "m/s",
    0.02,
    "speed over which the excess decays",
    "usual: 5 to 50 mm/s",
    0.02,
    (1e-3, 0.3),
    logarithmic=True,
)
EXPONENT = Parameter(
    "exponent",
    "1",
    1.0,
    "exponent of that decay: 1 decays at once, 2 after a shoulder",
    "usual: 1 to 2",
    1.5,
    (0.5, 3.0),
)
TAIL = Parameter(
    "tail",
    "1",
    1.0,
    "how far the excess extends to higher speeds: 0 decays as an exponential, 1 as a power",
    "Hess and Soom, J. Tribology 112, 1990: 1 / (1 + (v/v_s)^2)",
    0.1,
    (0.01, 2.0),
)
REST = 1e-3  # of the Stribeck speed: below it the curve is a parabola with finite slopes


class StribeckFriction(Effect):
    """Steady sliding takes F_r (1 + (ratio - 1) s(|v/v_s|^n)); the bristles follow it as in LuGre.

    s(z) = (1 + q z)^(-1/q) contains the usual curves: exp(-z) at q = 0 (Tustin, Bo and Pavelescu), Hess and Soom's
    1 / (1 + (v/v_s)^2) at q = 1 and n = 2. Stick-slip motion distinguishes them.
    """

    name = "stribeck_friction"
    sites = ("force.breakaway",)
    equation = "11"
    parameters = (RATIO, SPEED, EXPONENT, TAIL)
    strength = {"breakaway_ratio": 0.05}
    usual = tuple(
        {"breakaway_ratio": 1.4, "stribeck_speed": speed, "exponent": 1.5, "tail": 0.1}
        for speed in (0.008, 0.025, 0.07)
    )
    law = "steady sliding takes F_r (1 + (ratio - 1) (1 + q |v / v_s|^n)^(-1/q)), exp(-|v / v_s|^n) where q is 0"
    says = (
        "dry friction at rest is {breakaway_ratio} times that in motion; the excess decays over {stribeck_speed} "
        "(exponent {exponent}, tail {tail})"
    )
    depends_on = ("velocity",)
    needs = "slow motion, starts and reversals"
    look_alikes = ("presliding", "valve_deadband", "quadratic_drag", "asymmetric_friction")
    experiment = "ramps of 2 to 20 mm/s in both directions, at two speeds"
    source = "Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30(7), 1994"

    def active_range(
        self, values: Mapping[str, float], plant: Mapping[str, float]
    ) -> Mapping[str, tuple[float, float]]:
        """Speeds at which more than a tenth of the excess is left."""
        q = values["tail"]
        fast = values["stribeck_speed"] * ((10.0**q - 1.0) / q) ** (1.0 / values["exponent"])
        return {"velocity": (-fast, fast)}

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The limit of sliding friction at the speed of the contact, as a share of F_r."""
        square = (near["v"] / sheet.param(SPEED)) ** 2
        power = square * (square + REST**2) ** (sheet.param(EXPONENT) / 2 - 1)
        tail = sheet.param(TAIL)
        slow = ca.exp(-ca.log1p(tail * power) / tail)
        return nominal * (1 + (sheet.param(RATIO) - 1) * slow)
