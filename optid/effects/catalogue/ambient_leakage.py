"""Air that leaks from the chambers to the room: rod seal, fittings, tubes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect
from optid.effects.laminar_gap import LAMINAR, laminar_flux

LEAK = "usual: 0 to 0.3 mm2"
AREA_A = Parameter("area_a", "m**2", 1e-7, "flow area from chamber A to the room", LEAK, 0.0, (0.0, 5e-6))
AREA_B = Parameter("area_b", "m**2", 1e-7, "flow area from chamber B to the room", LEAK, 0.0, (0.0, 5e-6))


class AmbientLeakage(Effect):
    """Orifices to the room, by their effective areas: geometric area times discharge coefficient."""

    name = "ambient_leakage"
    sites = ("flow.chamber_a", "flow.chamber_b")
    equation = "1, 2"
    parameters = (AREA_A, AREA_B, LAMINAR)
    strength = {"area_a": 5e-9, "area_b": 5e-9}
    usual = tuple(
        {"area_a": a, "area_b": b, "laminar_share": share}
        for a, b in ((1e-7, 0.0), (0.0, 1e-7), (1e-7, 1e-7))
        for share in (0.0, 1.0)
    )
    law = (
        "m_leak = C_0 area P f(P_atm / P) / sqrt(T) out of each chamber, or with P^2 - P_atm^2 through a gap"
    )
    says = (
        "air leaks to the room, from chamber A through {area_a}, from chamber B through {area_b}; a share of "
        "{laminar_share} of it is laminar, as through a gap"
    )
    depends_on = (
        "pressure_a",
        "pressure_b",
    )
    needs = "holds with the valve nearly shut"
    look_alikes = ("valve_offset", "cross_leakage", "valve_underlap")
    experiment = "close the valve under pressure for 20 s and watch both pressures, or soap the fittings"
    source = "orifice of ISO 6358-1:2013 in the valve's own form"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The flow into the chamber, kg/s, minus the leak."""
        area = sheet.param(AREA_A if site.endswith("a") else AREA_B)
        orifice = near["ambient"] / sheet.plant_param("discharge_coefficient")
        gap = laminar_flux(sheet, sheet.plant_param("atmospheric_pressure"), near["P"])
        return nominal + area * (orifice + sheet.param(LAMINAR) * (gap - orifice))
