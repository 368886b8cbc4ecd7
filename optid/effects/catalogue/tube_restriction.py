"""Tubes and fittings between valve and cylinder that throttle the flow in series with the valve."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

LOSS = Parameter(
    "loss",
    "1",
    0.3,
    "share of the fully open valve's flow area that is lost to tubes and fittings in series",
    "usual: tubes of 4 to 20 mm2 behind a port of 25 mm2",
    0.0,
    (0.0, 0.97),
)


class TubeRestriction(Effect):
    """1/A^2 = 1/A_valve^2 + 1/A_tube^2 for filling and venting alike; A_tube from the loss at full opening."""

    name = "tube_restriction"
    sites = ("flow.supply_area", "flow.exhaust_area")
    equation = "1, 2"
    parameters = (LOSS,)
    strength = {"loss": 0.05}
    usual = ({"loss": 0.2}, {"loss": 0.6})
    law = "valve and tube in series: 1/A^2 = 1/A_valve^2 + 1/A_tube^2"
    says = (
        "tubes and fittings reduce the flow area of the fully open valve by {loss}, and that of the nearly "
        "closed one little"
    )
    depends_on = ("command", "flow")
    needs = "commands from small to full opening"
    look_alikes = (
        "valve_deadband",
        "valve_saturation",
        "supply_droop",
        "exhaust_restriction",
        "valve_underlap",
    )
    experiment = "steps of large amplitude with pressures measured at the valve's port and in the chamber"
    source = "ISO 6358-3:2014, components in series"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """Open area, m2, of valve and tube together."""
        full = sheet.plant_param("port_width") * sheet.plant_param("spool_travel")
        narrowing = 1 / (1 - sheet.param(LOSS)) ** 2 - 1  # (A_full / A_tube)^2
        return nominal / ca.sqrt(1 + narrowing * (nominal / full) ** 2)
