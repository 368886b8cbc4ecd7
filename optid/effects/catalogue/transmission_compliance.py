"""A shaft, belt or gear that winds up between motor and load."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect
from optid.effects.two_masses import SITES, STIFFEST, blend, motor_side, reduced, transmitted

COMPLIANCE = Parameter(
    "compliance",
    "m/N",
    1e-4,
    "twist per transmitted torque or force, from the motor to the load, in units of the output",
    "Spong, J. Dyn. Sys. Meas. Control 109, 1987; harmonic drives 1e-5 to 1e-3 rad/(N m), belts more",
    0.0,
    (0.0, 1e-2),
)
DAMPING = Parameter(
    "damping_ratio",
    "1",
    0.05,
    "damping ratio of motor against load",
    "steel 0.01, belts 0.1",
    0.05,
    (5e-3, 0.7),
)


class TransmissionCompliance(Effect):
    """Two masses, T = (twist + c d twist') / c; exact for natural frequencies below 120 Hz, rigid at c = 0."""

    name = "transmission_compliance"
    sites = SITES
    equation = "motion"
    parameters = (COMPLIANCE, DAMPING)
    strength = {"compliance": 8e-6}
    usual = tuple({"compliance": c, "damping_ratio": 0.05} for c in (2e-5, 8e-5, 3.2e-4, 1.3e-3))
    law = "motor and load are two masses; the shaft between them twists by c per torque"
    says = "the transmission winds up by {compliance} (damping ratio {damping_ratio}) between motor and load"
    depends_on = ("acceleration",)
    needs = "quick changes of the drive's torque that make motor and load oscillate against each other"
    look_alikes = ("compliant_load", "transmission_backlash", "sensor_lag")
    excludes = ("compliant_load", "transmission_backlash")
    experiment = "encoders on both ends of the transmission, or a swept sine of small torque"
    source = "Spong, J. Dyn. Sys. Meas. Control 109, 1987"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """Angle and speed of the motor's shaft, acceleration of the load."""
        c, ratio, inertia = sheet.param(COMPLIANCE), sheet.param(DAMPING), reduced(near)
        least = 1 / (STIFFEST**2 * inertia)
        counts = blend(c, least)
        if site != SITES[2]:
            return motor_side(sheet, site, nominal, counts)
        k = 1 / ca.fmax(c, least)
        twist, rate = sheet.recall("twist"), sheet.recall("rate")
        return transmitted(sheet, nominal, near, counts, k * twist + 2 * ratio * ca.sqrt(k * inertia) * rate)
