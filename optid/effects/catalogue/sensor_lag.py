"""A position sensor behind a filter."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

TIME = Parameter(
    "time_constant",
    "s",
    3e-3,
    "time constant of the sensor's filter",
    "usual: 0.5 to 10 ms",
    0.0,
    (0.0, 0.1),
)
SECOND = Parameter(
    "second",
    "1",
    0.5,
    "time constant of a second lag after the first, as a share of it",
    "filters of second order",
    0.0,
    (0.0, 1.0),
)
FLOOR = 5e-4  # s: keeps the equations from becoming stiff at the null


class SensorLag(Effect):
    """(1 + t0 p) / (1 + (t + t0) p) with p = d/dt, t = time constant: 1 at the null; followed by a second one.

    t0 falls from FLOOR with the square of t, so that a lag of usual size is the plain first-order one.

    The states are the lead of each filter's input over its output, so that they are small and start near zero.
    """

    name = "sensor_lag"
    sites = ("sensor.position",)
    equation = "output"
    parameters = (TIME, SECOND)
    strength = {"time_constant": 4e-4}
    usual = (
        {"time_constant": 2e-3, "second": 0.0},
        {"time_constant": 8e-3, "second": 0.0},
        {"time_constant": 4e-3, "second": 1.0},
    )
    law = "t y' + y = x, followed by a second lag with a share of t"
    says = (
        "the position sensor lags with a time constant of {time_constant}, followed by a second lag with "
        "{second} of it"
    )
    depends_on = ("velocity",)
    needs = "motion at changing speed"
    ahead_of = ("clock_drift",)
    look_alikes = ("valve_lag", "input_delay", "valve_rate_limit", "sensor_backlash")
    experiment = "measure the pressures too, or the position with a second sensor"
    source = "first-order filter"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The sensor's reading, m."""
        rate, shown, speed = near["v"], nominal, near["v"]
        for name, time in (
            ("ahead", sheet.param(TIME)),
            ("second_ahead", sheet.param(TIME) * sheet.param(SECOND)),
        ):
            ahead = sheet.state(name, "m", 1e-3, spread=5e-3)
            floor = FLOOR * (FLOOR / (time + FLOOR)) ** 2
            passed, share = ahead / (time + floor), time / (time + floor)
            sheet.rate(ahead, rate - passed)
            shown, speed, rate = shown - share * ahead, speed - share * (rate - passed), passed
        sheet.override_signal("v", speed)
        return shown
