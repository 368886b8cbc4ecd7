"""Air that leaks past the piston's seal from one chamber into the other."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect
from optid.effects.laminar_gap import LAMINAR, laminar_flux

AREA = Parameter(
    "area",
    "m**2",
    1e-7,
    "flow area between the chambers",
    "usual: 0 to 0.5 mm2, new below 0.005",
    0.0,
    (0.0, 5e-6),
)


class CrossLeakage(Effect):
    """An orifice between the chambers, by its effective area: geometric area times discharge coefficient."""

    name = "cross_leakage"
    sites = ("flow.chamber_a", "flow.chamber_b")
    equation = "1, 2"
    parameters = (AREA, LAMINAR)
    strength = {"area": 1e-8}
    usual = ({"area": 1e-7, "laminar_share": 0.0}, {"area": 1e-7, "laminar_share": 1.0})
    law = (
        "m_leak = C_0 area P_high f(P_low / P_high) / sqrt(T) from the chamber of higher pressure into the other, "
        "or with the "
        "difference of P^2 through a gap"
    )
    says = "air leaks past the piston through {area}; a share of {laminar_share} of it is laminar, as through a gap"
    depends_on = (
        "pressure_a",
        "pressure_b",
    )
    needs = "unequal chamber pressures, best in holds with the valve shut"
    look_alikes = ("valve_underlap", "valve_offset", "ambient_leakage", "valve_asymmetry")
    experiment = "close the valve at unequal pressures and watch them meet"
    source = "orifice of ISO 6358-1:2013 in the valve's own form"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The flow into the chamber, kg/s, with the leak from the other one."""
        orifice = near["other"] / sheet.plant_param("discharge_coefficient")
        gap = laminar_flux(sheet, near["other_P"], near["P"])
        return nominal + sheet.param(AREA) * (orifice + sheet.param(LAMINAR) * (gap - orifice))
