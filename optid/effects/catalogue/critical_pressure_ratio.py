"""Flow that chokes at another pressure ratio than an ideal nozzle's: the valve's b of ISO 6358."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

SHIFT = Parameter(
    "shift",
    "1",
    0.1,
    "critical pressure ratio of the valve less that of an ideal nozzle (0.528 for air)",
    "usual: valves have 0.15 to 0.5",
    0.0,
    (-0.5, 0.3),
)
INDEX = Parameter(
    "subsonic_index",
    "1",
    0.05,
    "power m of the subsonic branch; an ideal nozzle's is close to 0.5",
    "ISO 6358-1:2013: 0.5 where nothing else is known",
    0.5,
    (0.3, 0.8),
)
CLOSED = 1e-4  # of 1 - q^2: the power's slope stays finite at zero flow,
CHOKED = 1e-12  # of q^2: and at full flow
# Excess of an ideal nozzle's q over the ellipse's at the same flow, divided by q (1 - q): a parabola in q by least
# squares for air, accurate to 5e-6.
NOZZLE = (0.011920, -0.008484, 0.002724)
# Distance from the ideal nozzle's shift and power, half of what is worth a name, at which the branch is mostly ellipse.
AWAY = (0.01, 0.015)


class CriticalPressureRatio(Effect):
    """Eq. 7 with its subsonic branch stretched from (C_r, 1) to (C_r + shift, 1), and with another power.

    Away from the ideal nozzle the branch is that of ISO 6358-1, so that C_r + shift is the standard's b and the power
    its m: (1 - q^2)^m with q = (P_r - b) / (1 - b). The ideal nozzle deviates from that ellipse by up to 0.2 % of full
    flow.
    """

    name = "critical_pressure_ratio"
    sites = ("flow.ratio",)
    equation = "7, 8"
    parameters = (SHIFT, INDEX)
    strength = {"shift": 0.02, "subsonic_index": 0.03}
    usual = (
        *({"shift": shift, "subsonic_index": 0.5} for shift in (-0.15, -0.35, 0.08)),
        *({"shift": 0.0, "subsonic_index": m} for m in (0.44, 0.56)),
    )
    law = (
        "the flow is choked below P_r = C_r + shift and falls to zero at P_r = 1, with the subsonic index m of "
        "ISO 6358"
    )
    says = (
        "the valve's flow chokes at a pressure ratio that differs by {shift} from an ideal nozzle's 0.528, and "
        "falls beyond it with the subsonic index {subsonic_index}"
    )
    depends_on = ("pressure_a", "pressure_b", "flow")
    needs = "flow at small pressure differences: a chamber near supply or near exhaust pressure"
    look_alikes = ("supply_droop", "heat_transfer", "position_dependent_friction", "tube_restriction")
    experiment = "repeat the run at two supply pressures, with the chamber pressures measured"
    source = "ISO 6358-1:2013"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The pressure ratio at which eq. 7 passes the same flow."""
        shift, critical = sheet.param(SHIFT), near["critical"]
        stretched = nominal + shift * (nominal - 1) / (1 - critical - shift)
        q2 = (ca.fmax(stretched - critical, 0) / (1 - critical)) ** 2
        # 1 - (1 - q^2)^(2 m) for q^2, written so that it is q^2 to the last digit at m = 1/2.
        power = ca.exp((2 * sheet.param(INDEX) - 1) * ca.log((1 - q2) ** 2 + CLOSED**2) / 2)
        q = ca.sqrt(ca.fmax(q2 + (1 - q2) * (1 - power), CHOKED))
        away = (shift / AWAY[0]) ** 2 + ((sheet.param(INDEX) - 0.5) / AWAY[1]) ** 2
        q += (1 - ca.exp(-away)) * q * (1 - q) * (NOZZLE[0] + q * (NOZZLE[1] + q * NOZZLE[2]))
        bent = critical + (1 - critical) * q
        return ca.if_else(stretched > critical, bent, stretched)
