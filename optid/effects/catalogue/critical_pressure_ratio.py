"""Flow that chokes at another pressure ratio than an ideal nozzle's: the valve's b of ISO 6358."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

SHIFT = Parameter(
    "shift", "1", 0.1, "critical pressure ratio of the valve less that of an ideal nozzle (0.528 for air)",
    "physics catalogue A.2: valves have 0.15 to 0.5", 0.0, (-0.5, 0.3),
)  # fmt: skip


class CriticalPressureRatio(Effect):
    """Eq. 7 with its subsonic branch stretched from (C_r, 1) to (C_r + shift, 1).

    The branch is within 0.2 % of full flow of the ellipse of ISO 6358-1, so that C_r + shift is the standard's b.
    """

    name = "critical_pressure_ratio"
    sites = ("flow.ratio",)
    equation = "7, 8"
    parameters = (SHIFT,)
    strength = {"shift": 0.02}
    usual = ({"shift": -0.15}, {"shift": -0.35}, {"shift": 0.08})
    law = "the flow is choked below P_r = C_r + shift and falls to nothing at P_r = 1"
    says = "the valve's flow chokes at a pressure ratio that differs by {shift} from an ideal nozzle's 0.528"
    depends_on = ("pressure_a", "pressure_b", "flow")
    needs = "flow at small pressure differences: a chamber near supply or near exhaust pressure"
    look_alikes = ("supply_droop", "heat_transfer", "position_dependent_friction", "tube_restriction")
    experiment = "repeat at two supply pressures with the pressures measured"
    source = "ISO 6358-1:2013; sizes from physics catalogue A.2, row 23"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The pressure ratio at which eq. 7 passes the same flow."""
        shift, critical = sheet.param(SHIFT), near["critical"]
        return nominal + shift * (nominal - 1) / (1 - critical - shift)
