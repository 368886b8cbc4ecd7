"""A position sensor whose zero wanders while the recording runs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

RATE = Parameter(
    "rate", "m/s", 3e-5, "speed at which the zero moves", "physics catalogue A.4: 0.1 to 1 mm within a recording",
    0.0, (-1e-2, 1e-2),
)  # fmt: skip


class SensorDrift(Effect):
    """x + r t, with t from the start of each recording."""

    name = "sensor_drift"
    sites = ("sensor.position",)
    equation = "output"
    parameters = (RATE,)
    strength = {"rate": 6e-6}
    usual = ({"rate": 5e-5}, {"rate": -5e-5})
    law = "shown position is x + r t with the time t since the recording began"
    says = "the position sensor's zero drifts by {rate}"
    depends_on = ("time",)
    needs = "a long recording that returns to the same places, best to a stop"
    look_alikes = ("valve_offset", "sensor_nonlinearity", "friction_drift", "sensor_gain")
    experiment = "return to a stop every minute"
    source = "physics catalogue A.4, row 35"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """What the sensor shows, m."""
        return nominal + sheet.param(RATE) * sheet.clock()
