"""Back pressure behind the exhaust ports: a silencer, clogged or too small."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

BACK = Parameter(
    "back_pressure",
    "Pa",
    1e5,
    "absolute pressure that drives 10 g/s (500 l/min) of choked flow through the restriction",
    # A clogged silencer passes a few g/s at most: extrapolated to 10 g/s its pressure is many bar.
    "usual: 0 to 1 bar above ambient at the flows of the axis",
    0.0,
    (0.0, 5e6),
)
CRITICAL = Parameter(
    "critical_ratio",
    "1",
    0.1,
    "critical pressure ratio b of the restriction",
    "ISO 6358-1: 0.2 for a long silencer",
    0.5,
    (0.1, 0.55),
)
MANIFOLD = Parameter(
    "manifold",
    "m**3",
    3e-5,
    "volume between the valve's edges and the restriction",
    "a pipe of 0.1 to 1 m",
    3e-5,
    (1e-6, 1e-3),
    logarithmic=True,
)
LAMINAR = Parameter(
    "laminar_share",
    "1",
    0.2,
    "share of the rise that grows with the flow itself, as through a porous body",
    "sintered silencers; an orifice has none",
    0.0,
    (0.0, 1.0),
)
FLOW, LAG = 0.01, 1e-3  # kg/s; s: shortest filling time of the manifold
WARM = 84e3  # J/kg: R T of air in a workshop


class ExhaustRestriction(Effect):
    """A manifold at P that an orifice empties into P_e: the flow is P / R choked, R = back_pressure / (10 g/s).

    The state is the orifice's flow m; P(m) inverts the law of ISO 6358-1, and m follows what leaves the valve with the
    time constant V / (R_gas T) dP/dm, which is the manifold's balance of mass. Without resistance P is P_e.
    """

    name = "exhaust_restriction"
    sites = ("flow.exhaust", "flow.chamber_a", "flow.chamber_b")
    equation = "3-6"
    parameters = (BACK, CRITICAL, MANIFOLD, LAMINAR)
    strength = {"back_pressure": 5e4}
    usual = tuple(
        {"back_pressure": back, "critical_ratio": 0.4, "manifold": 3e-5, "laminar_share": share}
        for back, share in ((1.2e6, 0.0), (4e5, 0.0), (1e5, 0.0), (2e5, 0.0), (3e5, 1.0), (8e4, 1.0))
    )
    law = "the pressure behind the exhaust is the one that drives the flow through an orifice (ISO 6358)"
    says = (
        "the exhaust is throttled: 10 g/s would need {back_pressure} absolute behind it (critical pressure ratio "
        "{critical_ratio}, laminar share {laminar_share}, manifold {manifold})"
    )
    depends_on = ("flow", "pressure_a", "pressure_b")
    needs = "fast strokes in which a chamber is vented to below twice the exhaust pressure; above, the flow is choked"
    look_alikes = ("tube_restriction", "end_cushioning", "quadratic_drag", "supply_droop")
    experiment = "full strokes at full command with the silencer on and off"
    source = "ISO 6358-1:2013"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """Pressure behind the exhaust port, Pa; at the chambers the flow, kg/s, is only stored."""
        if site == "flow.exhaust":
            leaving = sheet.state("flow", "kg/s", 5e-3, spread=5e-3)
            resistance, share = sheet.param(BACK) / FLOW, sheet.param(LAMINAR)
            pressure, slope = behind(leaving, resistance, sheet.param(CRITICAL), nominal)
            pressure = (1 - share) * pressure + share * (nominal + resistance * ca.fmax(leaving, 0))
            slope = (1 - share) * slope + share * resistance
            sheet.store("leaving", leaving)
            sheet.store("slope", slope)
            sheet.store("area", near["area"])
            return pressure
        if site == "flow.chamber_a":
            sheet.store("into_a", near["exhaust"])
        else:
            into = ca.if_else(near["spool"] > 0, near["exhaust"], sheet.recall("into_a"))
            leaving = sheet.recall("leaving")
            lag = LAG + sheet.param(MANIFOLD) / WARM * sheet.recall("slope")
            sheet.rate(leaving, (-sheet.recall("area") * into - leaving) / lag)
        return nominal


def behind(flow: Any, resistance: Any, b: Any, ahead: Any) -> tuple[Any, Any]:
    """Pressure that drives a flow (kg/s) through an orifice into `ahead` (Pa), and its slope by the flow.

    ISO 6358-1: R m = P choked, else P sqrt(1 - ((ahead / P - b) / (1 - b))^2), which is a quadratic equation for P.
    """
    q = ca.fmax(flow, 0) * resistance
    choked = q > ahead / b
    c = 1 - b
    # (1 - 2 b) P^2 + 2 b ahead P - ahead^2 - (c q)^2 = 0; the form of the root that does not cancel at b = 1/2.
    half = b * ahead
    root = ca.sqrt(half**2 + (1 - 2 * b) * (ahead**2 + (c * q) ** 2))
    pressure = (ahead**2 + (c * q) ** 2) / (half + root)
    slope = c**2 * q * resistance / root
    return ca.if_else(choked, q, pressure), ca.if_else(choked, resistance, slope)
