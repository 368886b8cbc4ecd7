"""A liquid that leaks through scores and orifices: past the piston, past the rod."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.core.smooth import signed_root
from optid.effects.effect import Effect

SIZE = "a score of 0.1 mm2 passes 1 L/min of oil at 100 bar"
ACROSS, FROM_A, FROM_B = (
    Parameter(name, "m**2", 1e-7, f"effective area {words}", SIZE, 0.0, (0.0, 2e-6))
    for name, words in (
        ("across", "between the chambers"),
        ("from_a", "from chamber A to the drain"),
        ("from_b", "from chamber B to the drain"),
    )
)
LAMINAR = 1e5  # Pa: below it the flow is proportional to the pressure drop


class TurbulentLeakage(Effect):
    """Orifices in addition to the plant's own leaks, by their effective areas: area times discharge coefficient."""

    name = "turbulent_leakage"
    sites = ("flow.leak_a", "flow.leak_b")
    equation = "chamber balance"
    parameters = (ACROSS, FROM_A, FROM_B)
    strength = dict.fromkeys(("across", "from_a", "from_b"), 5e-9)
    usual = tuple(
        dict(zip(("across", "from_a", "from_b"), point, strict=True))
        for point in ((1e-7, 0.0, 0.0), (0.0, 1e-7, 0.0), (0.0, 0.0, 1e-7))
    )
    law = "the chambers lose A sqrt(2 (p_1 - p_2) / rho) to each other and to the drain"
    says = (
        "liquid leaks as through an orifice: {across} between the chambers, {from_a} from chamber A and {from_b} from "
        "chamber B to the drain"
    )
    depends_on = ("pressure_a", "pressure_b")
    needs = "pressures that differ widely, best in holds with the valve shut"
    look_alikes = ("laminar_leakage", "valve_offset", "viscosity_drift")
    experiment = (
        "close the valve and measure the drain's flow at two pressures: four times the pressure, double flow"
    )
    source = "Merritt, Hydraulic Control Systems, 1967, section 3-3"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """Flow into the chamber from its leaks, m3/s."""
        drained = sheet.param(FROM_A if site.endswith("a") else FROM_B)
        across, down = (signed_root(near["P"] - near[to], LAMINAR) for to in ("other", "drain"))
        per_root = ca.sqrt(2 / near["density"])
        return nominal - per_root * (sheet.param(ACROSS) * across + drained * down)
