"""A valve that opens further one way than the other for the same command."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

DIFFERENCE = Parameter(
    "gain_difference",
    "1",
    0.05,
    "(opening towards A - towards B) over their sum, for equal commands",
    "usual: 2 to 15 %",
    0.0,
    (-0.8, 0.8),
)


class ValveAsymmetry(Effect):
    """Spool s (1 + g sign s)."""

    name = "valve_asymmetry"
    sites = ("valve.spool",)
    equation = "3-6"
    parameters = (DIFFERENCE,)
    strength = {"gain_difference": 8e-3}
    usual = ({"gain_difference": 0.06}, {"gain_difference": -0.06})
    law = "ports open by s (1 + g) for positive and s (1 - g) for negative commands"
    says = (
        "the valve opens {gain_difference} more than its mean for positive commands and as much less for "
        "negative ones"
    )
    depends_on = ("command",)
    needs = "strokes in both directions at equal commands"
    look_alikes = ("valve_offset", "ambient_leakage", "cross_leakage", "asymmetric_friction")
    experiment = "strokes of equal command both ways at two speeds: an offset matters less at higher speed"
    source = "gain difference of the two directions of proportional valves"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """Opening of the ports, m."""
        return nominal + sheet.param(DIFFERENCE) * ca.fabs(nominal)
