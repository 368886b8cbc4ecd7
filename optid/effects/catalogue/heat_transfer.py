"""Heat between the air in the chambers and the cylinder's walls."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

COEFFICIENT = Parameter(
    "heat_transfer_coefficient",
    "W/(m**2 K)",
    50.0,
    "heat flow per wall area and temperature difference",
    "usual: 20 to 200 W/(m2 K)",
    0.0,
    (0.0, 2e3),
)
B_OVER_A = Parameter(
    "b_over_a",
    "1",
    0.5,
    "coefficient of chamber B over that of A: the rod adds wall area there, and the air flows differently",
    "a rod of half the bore: 73 % more wall than a circle of equal area",
    1.0,
    (0.3, 3.0),
    logarithmic=True,
)
STILL = 1.0  # W/(m2 K): less than still air; a lower bound, so that temperatures forget their start


class HeatTransfer(Effect):
    """Energy balance of each chamber with its own temperature T and heat h A_w (T_w - T) from the walls.

    The paper's eqs. 9 and 10 let air of supply temperature in and out and exchange no heat. Air leaving at T, not
    at supply temperature, counts by 1 - exp(-h / (1 W/(m2 K))): nothing at h = 0, in full at any size worth a name.
    """

    name = "heat_transfer"
    sites = ("flow.pressure_rate_a", "flow.pressure_rate_b")
    equation = "9, 10"
    parameters = (COEFFICIENT, B_OVER_A)
    strength = {"heat_transfer_coefficient": 8.0}
    usual = tuple({"heat_transfer_coefficient": h, "b_over_a": 1.0} for h in (30.0, 120.0))
    law = "P' gains (K - 1) h A_w (T_w - T) / V, with T from the chamber's energy balance"
    says = "air exchanges heat with the walls, {heat_transfer_coefficient} in chamber A and {b_over_a} times that in B"
    depends_on = ("pressure_a", "pressure_b", "velocity")
    needs = "fast moves followed by holds of about a second"
    look_alikes = ("tube_restriction", "critical_pressure_ratio", "ambient_leakage", "supply_droop")
    experiment = "hold after fast moves with the pressures measured: they creep for 0.1 to 1 s"
    source = "Carneiro and Almeida, Proc. IMechE I 220, 2006"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The chamber's rate of pressure, Pa/s."""
        K, R, T_s, T_w = (
            sheet.plant_param(name)
            for name in ("specific_heat_ratio", "gas_constant", "supply_temperature", "chamber_temperature")
        )
        T = sheet.state(f"temperature_{site[-1]}", "K", 20.0, start=T_w, spread=5.0)
        h = sheet.param(COEFFICIENT)
        little = ca.exp(-h / STILL)
        h = h * sheet.param(B_OVER_A) if site == self.sites[1] else h
        P, A, length = near["P"], near["area"], near["length"]
        V, m_in, m_out = A * length, ca.fmax(near["flow"], 0), ca.fmax(-near["flow"], 0)
        wall = 2 * A + 2 * ca.sqrt(math.pi * A) * length  # both ends, and the bore's circumference
        # d(ln T)/dt from P V = m R T and the balance of energy with air entering at T_s and leaving at T.
        heat = (K - 1) * (h + STILL * little) * wall * (T_w - T)
        through = R * (m_in * (K * T_s - T) - m_out * (K - 1) * T)
        sheet.rate(T, T * ((through + heat) / (P * V) - (K - 1) * near["widening"] / length))
        cooler = K * R * m_out * (T_s - T) + heat
        return nominal + (1 - little) * cooler / V
