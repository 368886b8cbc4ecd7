"""Back pressure behind the exhaust ports: a silencer, clogged or too small."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.core.smooth import soft_power
from optid.effects.effect import Effect

BACK = Parameter(
    "back_pressure", "Pa", 3e4, "by which the pressure behind the exhaust rises at a flow of 10 g/s (500 l/min)",
    # A clogged silencer lets a few g/s through at most: carried on to 10 g/s its pressure is many bar.
    "physics catalogue A.3: 0 to 1 bar at the flows of the axis", 0.0, (0.0, 5e6),
)  # fmt: skip
EXPONENT = Parameter(
    "exponent", "1", 1.0, "power of the flow with which it rises", "a choked silencer has 1, a wide one 2",
    1.5, (1.0, 2.0),
)  # fmt: skip
MANIFOLD = Parameter(
    "manifold", "m**3", 3e-5, "volume between the valve's edges and what restricts", "a pipe of 0.1 to 1 m",
    3e-5, (1e-6, 1e-3), logarithmic=True,
)  # fmt: skip
FLOW, LAG = 0.01, 1e-3  # kg/s; s: in which the manifold fills at least
WARM = 84e3  # J/kg: R T of air in a workshop
SMALL = 1e-3  # flow over FLOW below which the power law is a line


class ExhaustRestriction(Effect):
    """P_e + back_pressure (m / 10 g/s)^k with m the flow that leaves through the valve."""

    name = "exhaust_restriction"
    sites = ("flow.exhaust", "flow.chamber_a", "flow.chamber_b")
    equation = "3-6"
    parameters = (BACK, EXPONENT, MANIFOLD)
    strength = {"back_pressure": 6e3}
    usual = tuple(
        {"back_pressure": back, "exponent": k, "manifold": 3e-5}
        for back in (1.2e6, 3e5, 6e4, 1.5e4) for k in (1.0, 2.0)
    )  # fmt: skip
    law = "the pressure behind the exhaust rises by back_pressure (m / 10 g/s)^k"
    says = (
        "the exhaust builds up a back pressure of {back_pressure} at a flow of 10 g/s (power {exponent} of the flow) "
        "behind a manifold of {manifold}"
    )
    depends_on = ("flow", "pressure_a", "pressure_b")
    needs = "fast strokes in which a chamber is vented to below twice the exhaust pressure; above, the flow is choked"
    look_alikes = ("tube_restriction", "end_cushioning", "quadratic_drag", "supply_droop")
    experiment = "full strokes at full command with the silencer on and off"
    source = "physics catalogue A.3, row 25"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """Pressure behind the exhaust port, Pa; at the chambers the flow, kg/s, is only taken note of."""
        if site == "flow.exhaust":
            leaving = sheet.state("flow", "kg/s", 5e-3, spread=5e-3)
            sheet.note("leaving", leaving)
            sheet.note("area", near["area"])
            power = soft_power(ca.fmax(leaving, 0) / FLOW, sheet.param(EXPONENT), SMALL)
            return nominal + sheet.param(BACK) * power
        if site == "flow.chamber_a":
            sheet.note("into_a", near["exhaust"])
        else:
            into = ca.if_else(near["spool"] > 0, near["exhaust"], sheet.noted("into_a"))
            leaving = sheet.noted("leaving")
            lag = LAG + sheet.param(MANIFOLD) * sheet.param(BACK) / (FLOW * WARM)
            sheet.rate(leaving, (-sheet.noted("area") * into - leaving) / lag)
        return nominal
