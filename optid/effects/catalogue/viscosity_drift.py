"""Oil that warms while the recording runs: viscous friction falls, gaps leak more."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

RATE = Parameter(
    "rate",
    "1/s",
    0.01,
    "relative change of the viscosity per second at the start of a recording",
    "mineral oil halves its viscosity in 15 to 20 K",
    0.0,
    (-1.0, 1.0),
)
SETTLING = Parameter(
    "settling_time",
    "s",
    10.0,
    "time constant with which it settles; long for a steady drift",
    "a valve's block warms in seconds, a tank in an hour",
    60.0,
    (0.5, 1e4),
    logarithmic=True,
)
MOST = 2.0  # largest change, as a logarithm: keeps long recordings within a factor of 7


class ViscosityDrift(Effect):
    """Friction times exp(e), leaks by exp(-e), e = r s (1 - exp(-t / s)), with t from each recording's start."""

    name = "viscosity_drift"
    sites = ("force.viscous", "flow.leak_a", "flow.leak_b")
    equation = "motion, chamber balance"
    parameters = (RATE, SETTLING)
    strength = {"rate": 3e-3}
    usual = tuple(
        {"rate": sign * rate, "settling_time": time}
        for rate, time in ((0.03, 60.0), (0.1, 3.0))
        for sign in (1, -1)
    )
    law = "viscous friction grows and laminar leakage falls by exp(e), e' = r at first, which settles"
    says = "the oil's viscosity drifts while the recording runs, by {rate} at first, and settles with {settling_time}"
    depends_on = ("time", "velocity")
    needs = "motion from the recording's start to its end"
    ahead_of = ("turbulent_leakage", "asymmetric_friction")
    look_alikes = ("friction_drift", "laminar_leakage", "quadratic_drag")
    experiment = "repeat the same stroke twenty times from cold to warm, with the oil's temperature"
    source = "Jelali and Kroll, Hydraulic Servo-systems, 2003, section 3.1"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """Viscous friction, N, or the flow of laminar leaks, m3/s."""
        settling = sheet.param(SETTLING)
        exponent = sheet.param(RATE) * settling * (1 - ca.exp(-sheet.clock() / settling))
        way = 1 if site == "force.viscous" else -1
        return nominal * ca.exp(way * MOST * ca.tanh(exponent / MOST))
