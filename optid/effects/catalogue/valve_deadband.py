"""A spool that overlaps its ports: small commands move no air."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.core.smooth import dead_zone
from optid.effects.effect import Effect

WIDTH = Parameter(
    "width", "1", 0.01, "half the dead zone, as a share of full command", "physics catalogue A.2: 0.2 to 5 %",
    0.0, (0.0, 0.5),
)  # fmt: skip


class ValveDeadband(Effect):
    """The spool's way less the overlap; valve_offset makes the two edges unequal."""

    name = "valve_deadband"
    sites = ("valve.spool",)
    equation = "3-6"
    parameters = (WIDTH,)
    strength = {"width": 1.5e-3}
    usual = ({"width": 0.01}, {"width": 0.04})
    law = "ports open by what the spool's way exceeds the overlap d, to either side"
    says = "the valve's ports stay shut for the first {width} of full command to either side"
    depends_on = ("command",)
    needs = "commands that pass slowly through zero"
    look_alikes = ("valve_underlap", "valve_hysteresis", "stribeck_friction", "tube_restriction")
    excludes = ("valve_underlap",)
    experiment = "small steps of the command about zero at several pressures, with the pressures measured"
    source = "Tao, Meng and others, Math. Probl. Eng. 2034923, 2016; sizes from physics catalogue A.2, row 15"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """Opening of the ports, m."""
        return dead_zone(nominal, sheet.param(WIDTH) * sheet.plant_param("spool_travel"))
