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
    "droop",
    "Pa",
    2e4,
    "pressure drop of the supply at a steady flow of 10 g/s (500 l/min), if its line did not choke",
    # A narrow line of a small axis passes a few g/s: extrapolated to 10 g/s its droop is many bar.
    "usual: 0.1 to 1.5 bar at a full flow of 28 g/s",
    0.0,
    (0.0, 2e6),
)
RECOVERY = Parameter(
    "recovery_time",
    "s",
    0.05,
    "time constant with which the supply sags and recovers, at a flow of 10 g/s",
    "usual: 20 to 300 ms",
    0.05,
    (5e-4, 2.0),
    logarithmic=True,
)
EXPONENT = Parameter(
    "exponent",
    "1",
    1.0,
    "power of the flow with which it sags, far from choking",
    "a regulator has 1, an orifice 2",
    1.0,
    (1.0, 2.0),
)
CRITICAL = Parameter(
    "critical_ratio",
    "1",
    0.1,
    "pressure ratio over the line at which its flow chokes",
    "ISO 6358-1: 0.528 for a nozzle, less for a long line",
    0.5,
    (0.1, 0.6),
)
FLOW = 0.01  # kg/s
SMALL = 1e-3  # flow over FLOW below which the power law is a line
LAG = 2.2e-3  # s: shortest time constant of the sag; a shorter one would make the plant stiff
LEAST = 0.25  # share of the supply pressure that is always left: keeps the flow function in its range


class SupplyDroop(Effect):
    """A sag of D, up to C = (1 - b) P_s, lets a line deliver 10 g/s ((D / droop) (1 - D / 2 C))^(1/k), then no more.

    With k = 2 that is the ellipse of ISO 6358-1. The state q is a flow, the sag droop (q / 10 g/s)^k; a volume after
    the line is filled by the difference of delivered and drawn flow, in proportion to the slope of the sag over q.
    """

    name = "supply_droop"
    sites = ("flow.supply", "flow.chamber_a", "flow.chamber_b")
    equation = "3-6"
    parameters = (DROOP, RECOVERY, EXPONENT, CRITICAL)
    strength = {"droop": 2e3}
    usual = tuple(
        {"droop": droop, "recovery_time": time, "exponent": k, "critical_ratio": 0.5}
        for droop, k in ((1e5, 1.0), (2e4, 1.0), (2e5, 2.0))
        for time in (0.01, 0.05, 0.25)
    )
    law = "P_s falls by droop (m / 10 g/s)^k, by more as the line chokes; the volume between line and valve smooths it"
    says = (
        "the supply pressure would sag by {droop} at a flow of 10 g/s if its line did not choke (power {exponent} of "
        "the flow; it chokes at a pressure ratio of {critical_ratio}) and takes {recovery_time} to follow"
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
    source = "ISO 6358-1:2013"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """Supply pressure at the valve, Pa; at the chambers the flow, kg/s, is only stored."""
        if site == "flow.supply":
            drawn = sheet.state("flow", "kg/s", 5e-3, spread=5e-3)
            sheet.store("drawn", drawn)
            sheet.store("area", near["area"])
            exponent = sheet.param(EXPONENT)
            sag = sheet.param(DROOP) * soft_power(ca.fmax(drawn, 0) / FLOW, exponent, SMALL)
            most = (1 - sheet.param(CRITICAL)) * nominal
            passed = ca.fmin(sag, most)
            choked = most / ca.fmax(sag, most) * (1 - passed / (2 * most))
            sheet.store("delivered", drawn * ca.exp(ca.log(choked) / exponent))
            return ca.fmax(nominal - sag, LEAST * nominal)
        if site == "flow.chamber_a":
            sheet.store("into_a", near["supply"])
        else:
            flow = sheet.recall("area") * ca.if_else(
                near["spool"] > 0, sheet.recall("into_a"), near["supply"]
            )
            drawn = sheet.recall("drawn")
            slope = ((drawn / FLOW) ** 2 + SMALL**2) ** ((sheet.param(EXPONENT) - 1) / 2)
            sheet.rate(drawn, (flow - sheet.recall("delivered")) / (LAG + sheet.param(RECOVERY) * slope))
        return nominal
