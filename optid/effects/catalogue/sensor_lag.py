"""A position sensor behind a filter."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

TIME = Parameter(
    "time_constant", "s", 3e-3, "time constant of the sensor's filter", "physics catalogue A.4: 0.5 to 10 ms",
    0.0, (0.0, 0.1),
)  # fmt: skip
FLOOR = 5e-4  # s: keeps the equations from becoming stiff at the null


class SensorLag(Effect):
    """(1 + t0 p) / (1 + (t + t0) p) with p = d/dt, t = time constant: 1 at the null.

    t0 falls from FLOOR with the square of t, so that a lag of usual size is the plain first-order one.

    The state is how far the axis is ahead of the filter, so that it is small and starts near zero.
    """

    name = "sensor_lag"
    sites = ("sensor.position",)
    equation = "output"
    parameters = (TIME,)
    strength = {"time_constant": 4e-4}
    usual = ({"time_constant": 2e-3}, {"time_constant": 8e-3})
    law = "t y' + y = x"
    says = "the position sensor lags with a time constant of {time_constant}"
    depends_on = ("velocity",)
    needs = "motion at changing speed"
    look_alikes = ("valve_lag", "input_delay", "valve_rate_limit", "sensor_backlash")
    experiment = "measure the pressures too, or the position with a second sensor"
    source = "first-order filter; sizes from physics catalogue A.4, row 37"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """What the sensor shows, m."""
        time = sheet.param(TIME)
        ahead = sheet.state("ahead", "m", 1e-3, spread=5e-3)
        floor = FLOOR * (FLOOR / (time + FLOOR)) ** 2
        sheet.rate(ahead, near["v"] - ahead / (time + floor))
        return nominal - time / (time + floor) * ahead
