"""Dry friction that changes while the recording runs: warming up, drying out, wear."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

RATE = Parameter(
    "rate", "1/s", 0.01, "relative change of dry friction per second at the start of a recording",
    "physics catalogue A.1: 5 to 40 % within a recording", 0.0, (-1.0, 1.0),
)  # fmt: skip
SETTLING = Parameter(
    "settling_time", "s", 10.0, "time constant with which it settles; long for a steady drift",
    "warming up takes minutes, a film of oil seconds", 60.0, (0.5, 1e4), logarithmic=True,
)  # fmt: skip
MOST = 2.0  # largest change, as a logarithm: keeps long recordings within a factor of 7


class FrictionDrift(Effect):
    """F_r exp(r s (1 - exp(-t / s))), with t from the start of each recording: F_r exp(r t) for t << s."""

    name = "friction_drift"
    sites = ("force.coulomb",)
    equation = "11"
    parameters = (RATE, SETTLING)
    strength = {"rate": 2e-3}
    usual = tuple(
        {"rate": sign * rate, "settling_time": settling}
        for rate, settling in ((0.015, 60.0), (0.05, 3.0))
        for sign in (1, -1)
    )
    law = "dry friction grows from F_r at the rate r F_r and settles, with the time since the recording began"
    says = (
        "dry friction drifts while the recording runs, by {rate} at first, and settles with {settling_time}"
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
    experiment = "the same stroke twenty times from cold to warm"
    source = "physics catalogue A.1, row 14"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The level of dry friction, N."""
        settling = sheet.param(SETTLING)
        exponent = sheet.param(RATE) * settling * (1 - ca.exp(-sheet.clock() / settling))
        return nominal * ca.exp(MOST * ca.tanh(exponent / MOST))
