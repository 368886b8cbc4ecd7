"""Play in a gear or coupling between motor and load."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.core.smooth import dead_zone
from optid.effects.effect import Effect
from optid.effects.two_masses import SITES, STIFFEST, blend, motor_side, reduced, transmitted

PLAY = Parameter(
    "play",
    "m",
    5e-4,
    "half the clearance between motor and load, in units of the output",
    "spur gears 1e-3 to 1e-2 rad, planetary gears 3e-4 to 3e-3 rad",
    0.0,
    (0.0, 1e-2),
)
CONTACT = Parameter(
    "contact_frequency",
    "Hz",
    60.0,
    "natural frequency of motor against load while the teeth are in contact",
    "Nordin and Gutman, Automatica 38, 2002: 10 to 100 Hz",
    60.0,
    (10.0, 120.0),
    logarithmic=True,
)
DAMPING = 0.2  # damping ratio of teeth in contact
LEAST = 2e-5  # m: a smaller play is partly rigid


class TransmissionBacklash(Effect):
    """Two masses and a spring that transmits nothing within the play: Nordin and Gutman's dead zone."""

    name = "transmission_backlash"
    sites = SITES
    equation = "motion"
    parameters = (PLAY, CONTACT)
    strength = {"play": 4e-5}
    usual = tuple(
        {"play": play, "contact_frequency": f} for play in (1e-4, 4e-4, 1.6e-3) for f in (40.0, 100.0)
    )
    law = "motor and load are two masses; the transmission between them transmits k times the twist beyond the play"
    says = (
        "motor and load have a play of {play} to each side (in contact they oscillate at {contact_frequency})"
    )
    depends_on = ("velocity",)
    needs = "reversals of the transmitted torque"
    look_alikes = ("transmission_compliance", "sensor_backlash", "presliding", "compliant_load")
    excludes = ("compliant_load", "transmission_compliance")
    experiment = "hold the motor and move the load by hand, against a dial gauge"
    source = "Nordin and Gutman, Automatica 38(10), 2002"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """Angle and speed of the motor's shaft, acceleration of the load."""
        play, f, inertia = sheet.param(PLAY), sheet.param(CONTACT), reduced(near)
        counts = blend(play, sheet.length(LEAST))
        if site != SITES[2]:
            return motor_side(sheet, site, nominal, counts)
        k = ca.fmin(2 * math.pi * f, STIFFEST) ** 2 * inertia
        twist, rate = sheet.recall("twist"), sheet.recall("rate")
        damped = 2 * DAMPING * ca.sqrt(k * inertia) * rate * (ca.fabs(twist) > play)
        return transmitted(sheet, nominal, near, counts, k * dead_zone(twist, play) + damped)
