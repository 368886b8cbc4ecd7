"""A spool that is not in the middle at zero command."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

OFFSET = Parameter(
    "offset",
    "1",
    0.01,
    "position of the spool at zero command, as a share of full command",
    "usual: 0.1 to 3 %",
    0.0,
    (-0.5, 0.5),
)


class ValveOffset(Effect):
    """A constant added to the command."""

    name = "valve_offset"
    sites = ("valve.command",)
    equation = "3-6"
    parameters = (OFFSET,)
    strength = {"offset": 5e-4}
    usual = ({"offset": 0.005}, {"offset": -0.005})
    law = "the spool follows command + offset"
    says = "the valve has a zero offset of {offset} of full command"
    depends_on = ("command",)
    needs = "holds and slow motion"
    ahead_of = ("valve_lag", "valve_rate_limit", "valve_saturation")
    look_alikes = ("ambient_leakage", "cross_leakage", "valve_asymmetry", "constant_force")
    experiment = "find the command at which the axis stands still, at two supply pressures"
    source = "zero offset of proportional valves"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """Command, a share of full command."""
        return nominal + sheet.param(OFFSET)
