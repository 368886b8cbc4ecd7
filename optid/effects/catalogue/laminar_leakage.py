"""A liquid that leaks through narrow gaps: past the piston, past the rod."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

SIZE = "Merritt, Hydraulic Control Systems, 1967: worn seals pass 0.1 to 5 L/min at 100 bar"
ACROSS, FROM_A, FROM_B = (
    Parameter(name, "m**3/(s Pa)", 1e-12, f"leakage {words}", SIZE, 0.0, (0.0, 1e-9))
    for name, words in (
        ("across", "between the chambers"),
        ("from_a", "from chamber A to the drain"),
        ("from_b", "from chamber B to the drain"),
    )
)


class LaminarLeakage(Effect):
    """Flows in proportion to the pressure drop, in addition to the plant's own (Hagen and Poiseuille)."""

    name = "laminar_leakage"
    sites = ("flow.leak_a", "flow.leak_b")
    equation = "chamber balance"
    parameters = (ACROSS, FROM_A, FROM_B)
    strength = dict.fromkeys(("across", "from_a", "from_b"), 1e-13)
    usual = tuple(
        dict(zip(("across", "from_a", "from_b"), point, strict=True))
        for point in ((2e-12, 0.0, 0.0), (0.0, 2e-12, 0.0), (0.0, 0.0, 2e-12))
    )
    law = "the chambers lose C (p_1 - p_2) to each other and to the drain"
    says = (
        "liquid leaks in proportion to the pressure drop: {across} between the chambers, {from_a} from chamber A and "
        "{from_b} from chamber B to the drain"
    )
    depends_on = ("pressure_a", "pressure_b")
    needs = "pressures that differ, best in holds with the valve shut"
    ahead_of = ("viscosity_drift", "turbulent_leakage")
    look_alikes = ("turbulent_leakage", "valve_offset", "viscosity_drift")
    experiment = "close the valve and measure the drain's flow at two pressures: double pressure, double flow"
    source = "Merritt, Hydraulic Control Systems, 1967, section 3-2"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """Flow into the chamber from its leaks, m3/s."""
        drained = sheet.param(FROM_A if site.endswith("a") else FROM_B)
        P = near["P"]
        return nominal - sheet.param(ACROSS) * (P - near["other"]) - drained * (P - near["drain"])
