"""Dry friction that changes while the recording runs: warming up, drying out, wear."""

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
    "relative change of dry friction per second at the start of a recording",
    "usual: 5 to 40 % within a recording",
    0.0,
    (-1.0, 1.0),
)
SETTLING = Parameter(
    "settling_time",
    "s",
    10.0,
    "time constant with which it settles; long for a steady drift",
    "warming up takes minutes, a film of oil seconds",
    60.0,
    (0.5, 1e4),
    logarithmic=True,
)
STRAIGHTNESS = Parameter(
    "straightness",
    "1",
    0.5,
    "1: friction itself changes at the rate and settles; towards 0: its logarithm does",
    "a seal's friction falls about in proportion to its warming, a film's viscosity exponentially",
    0.5,
    (0.05, 1.0),
)
LEAST = 0.05  # of the initial friction, where it would fall to zero
MOST = 2.0  # largest change, as a logarithm: keeps long recordings within a factor of 7


class FrictionDrift(Effect):
    """F_r (1 + b e)^(1/b), e = r s (1 - exp(-t / s)), with t from each recording's start; F_r exp(e) for small b.

    The power between a change of friction and one of its logarithm is Box and Cox's (J. R. Stat. Soc. B 26, 1964).
    """

    name = "friction_drift"
    sites = ("force.coulomb",)
    equation = "11"
    parameters = (RATE, SETTLING, STRAIGHTNESS)
    strength = {"rate": 2e-3}
    usual = tuple(
        {"rate": sign * rate, "settling_time": settling, "straightness": 0.5}
        for rate, settling in ((0.015, 60.0), (0.05, 3.0))
        for sign in (1, -1)
    )
    law = "dry friction grows from F_r at the rate r F_r and settles, with the time since the recording began"
    says = (
        "dry friction drifts while the recording runs, by {rate} at first, and settles with {settling_time} "
        "(straightness {straightness}: 1, friction itself changes at this rate; 0, its logarithm)"
    )
    depends_on = ("time",)
    needs = "motion from the recording's start to its end"
    ahead_of = ("presliding",)
    look_alikes = (
        "pressure_dependent_friction",
        "position_dependent_friction",
        "sensor_drift",
        "supply_droop",
    )
    experiment = "repeat the same stroke twenty times from cold to warm"
    source = "warming up, drying out and wear of seals and guides"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The level of dry friction, N."""
        settling = sheet.param(SETTLING)
        exponent = sheet.param(RATE) * settling * (1 - ca.exp(-sheet.clock() / settling))
        straight = sheet.param(STRAIGHTNESS)
        grown = 1 + straight * MOST * ca.tanh(exponent / MOST)
        return nominal * ca.exp(ca.log(ca.fmax(grown, LEAST)) / straight)
