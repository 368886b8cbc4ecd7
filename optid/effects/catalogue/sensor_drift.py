"""A position sensor whose zero drifts during the recording."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

RATE = Parameter(
    "rate",
    "m/s",
    3e-5,
    "speed at which the zero moves at the start of a recording",
    "usual: 0.1 to 1 mm within a recording",
    0.0,
    (-1e-2, 1e-2),
)
SETTLING = Parameter(
    "settling_time",
    "s",
    10.0,
    "time constant with which it settles; long for a steady drift",
    "an amplifier warms up in seconds to minutes",
    60.0,
    (0.5, 1e4),
    logarithmic=True,
)


class SensorDrift(Effect):
    """x + r s (1 - exp(-t / s)), with t from the start of each recording: x + r t for t << s."""

    name = "sensor_drift"
    sites = ("sensor.position",)
    equation = "output"
    parameters = (RATE, SETTLING)
    strength = {"rate": 6e-6}
    usual = tuple(
        {"rate": sign * rate, "settling_time": settling}
        for rate, settling in ((5e-5, 60.0), (2e-4, 3.0))
        for sign in (1, -1)
    )
    law = (
        "the measured position drifts from x at the rate r and settles, with the time since the start of the "
        "recording"
    )
    says = "the position sensor's zero drifts by {rate} at first, and settles with {settling_time}"
    depends_on = ("time",)
    needs = "a long recording that returns to the same places, best to a stop"
    look_alikes = ("valve_offset", "sensor_nonlinearity", "friction_drift", "sensor_gain")
    experiment = "return to a stop every minute"
    source = "zero drift of position sensors while they warm up"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The sensor's reading, m."""
        settling = sheet.param(SETTLING)
        return nominal + sheet.param(RATE) * settling * (1 - ca.exp(-sheet.clock() / settling))
