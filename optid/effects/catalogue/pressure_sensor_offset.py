"""Pressure sensors with an offset."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

ABOUT = "measured minus true pressure, chamber"
SIZE = "0.5 % of a range of 10 bar is 0.05 bar"
OFFSET_A = Parameter("offset_a", "Pa", 1e4, f"{ABOUT} A", SIZE, 0.0, (-2e5, 2e5))
OFFSET_B = Parameter("offset_b", "Pa", 1e4, f"{ABOUT} B", SIZE, 0.0, (-2e5, 2e5))


class PressureSensorOffset(Effect):
    """A constant on each pressure signal."""

    name = "pressure_sensor_offset"
    sites = ("sensor.pressure_a", "sensor.pressure_b")
    equation = "output"
    parameters = (OFFSET_A, OFFSET_B)
    strength = {"offset_a": 2e3, "offset_b": 2e3}
    usual = tuple(
        {"offset_a": a, "offset_b": b} for a, b in ((1e4, 0.0), (-1e4, 0.0), (0.0, 1e4), (0.0, -1e4))
    )
    law = "the measured pressures are P_a + o_a and P_b + o_b"
    says = "the pressure sensors have an offset of {offset_a} at chamber A and {offset_b} at chamber B"
    depends_on = (
        "pressure_a",
        "pressure_b",
    )
    needs = "recorded pressures"
    look_alikes = ("constant_force", "asymmetric_friction")
    experiment = "vent both chambers to the room and read the sensors"
    source = "data sheets of pressure sensors of the 0.5 % class"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The sensor's reading, Pa."""
        return nominal + sheet.param(OFFSET_A if site.endswith("a") else OFFSET_B)
