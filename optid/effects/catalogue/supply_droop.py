"""A supply whose pressure sags when air is drawn: the regulator, a long line, a small reservoir."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.core.smooth import soft_power
from optid.effects.effect import Effect

DROOP = Parameter(
    "droop", "Pa", 2e4, "by which the supply sags at a steady flow of 10 g/s (500 l/min)",
    # A narrow line behind a small axis passes a few g/s: carried on to 10 g/s its droop is many bar.
    "physics catalogue A.3: 0.1 to 1.5 bar at a full flow of 28 g/s", 0.0, (0.0, 2e6),
)  # fmt: skip
RECOVERY = Parameter(
    "recovery_time", "s", 0.05, "time constant with which the supply sags and recovers, at a flow of 10 g/s",
    "physics catalogue A.3: 20 to 300 ms", 0.05, (5e-4, 2.0), logarithmic=True,
)  # fmt: skip
EXPONENT = Parameter(
    "exponent",
    "1",
    1.0,
    "power of the flow with which it sags",
    "a regulator has 1, a wide line 2, one that is about to choke more",
    1.0,
    (1.0, 2.5),
)
FLOW = 0.01  # kg/s
SMALL = 1e-3  # flow over FLOW below which the power law is a line
LAG = 2.2e-3  # s: in which it sags at least; less would make the plant stiff
LEAST = 0.25  # share of the supply pressure that is always left: keeps the flow function in its range


class SupplyDroop(Effect):
    """P_s - droop (m / 10 g/s)^k, with m what the line delivers: the flow drawn, behind a lag.

    A volume behind a line is filled in proportion to the slope of its law, so that the lag goes with the power k - 1 of
    the flow; a regulator's, k = 1, does not depend on it.
    """

    name = "supply_droop"
    sites = ("flow.supply", "flow.chamber_a", "flow.chamber_b")
    equation = "3-6"
    parameters = (DROOP, RECOVERY, EXPONENT)
    strength = {"droop": 2e3}
    usual = tuple(
        {"droop": droop, "recovery_time": time, "exponent": k}
        for droop, k in ((1e5, 1.0), (2e4, 1.0), (2e5, 2.0)) for time in (0.01, 0.05, 0.25)
    )  # fmt: skip
    law = "P_s falls by droop (m / 10 g/s)^k; m lags what is drawn by the recovery time, times (m / 10 g/s)^(k - 1)"
    says = (
        "the supply pressure sags by {droop} at a flow of 10 g/s (power {exponent} of the flow) and takes "
        "{recovery_time} to follow"
    )
    depends_on = ("flow", "pressure_a", "pressure_b")
    needs = "fast strokes that draw much air"
    look_alikes = (
        "tube_restriction",
        "critical_pressure_ratio",
        "valve_saturation",
        "quadratic_drag",
        "heat_transfer",
    )
    experiment = "a pressure sensor at the valve's supply port"
    source = "physics catalogue A.3, row 24"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """Supply pressure at the valve, Pa; at the chambers the flow, kg/s, is only taken note of."""
        if site == "flow.supply":
            drawn = sheet.state("flow", "kg/s", 5e-3, spread=5e-3)
            sheet.note("drawn", drawn)
            sheet.note("area", near["area"])
            power = soft_power(ca.fmax(drawn, 0) / FLOW, sheet.param(EXPONENT), SMALL)
            return ca.fmax(nominal - sheet.param(DROOP) * power, LEAST * nominal)
        if site == "flow.chamber_a":
            sheet.note("into_a", near["supply"])
        else:
            flow = sheet.noted("area") * ca.if_else(near["spool"] > 0, sheet.noted("into_a"), near["supply"])
            drawn = sheet.noted("drawn")
            slope = ((drawn / FLOW) ** 2 + SMALL**2) ** ((sheet.param(EXPONENT) - 1) / 2)
            sheet.rate(drawn, (flow - drawn) / (LAG + sheet.param(RECOVERY) * slope))
        return nominal
