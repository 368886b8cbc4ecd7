"""A position sensor with a gain error."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

ERROR = Parameter(
    "gain_error",
    "1",
    0.01,
    "measured distance over true distance, minus 1",
    "usual: 0.2 to 3 %",
    0.0,
    (-0.5, 0.5),
)


class SensorGain(Effect):
    """x (1 + g), from mid-stroke."""

    name = "sensor_gain"
    sites = ("sensor.position",)
    equation = "output"
    parameters = (ERROR,)
    strength = {"gain_error": 1.5e-3}
    usual = ({"gain_error": 0.01}, {"gain_error": -0.01})
    law = "the measured position is x (1 + g)"
    says = "the position sensor has a gain error of {gain_error}"
    depends_on = ("position",)
    needs = "strokes from near one end to near the other"
    look_alikes = ("sensor_nonlinearity", "spring_load", "heat_transfer")
    experiment = "gauge blocks, or the known stroke between the end stops"
    source = "scale error of a sensor and its converter"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The sensor's reading, m."""
        return nominal + sheet.param(ERROR) * near["x"]
