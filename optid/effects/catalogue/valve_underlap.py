"""A spool narrower than its ports: near the middle both edges of a port stand open."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.edges import ALIKE, EDGES, SAID, edge
from optid.effects.effect import Effect

WIDTH = Parameter(
    "width",
    "1",
    5e-3,
    "travel of the spool from the middle at which the other edge closes, as a share of full command",
    "usual: 0 to 0.1 mm of 4 mm",
    0.0,
    (0.0, 0.3),
)

AREA = Parameter(
    "null_leakage",
    "m**2",
    1e-7,
    "flow area of every edge in addition to its opening, from worn corners",
    "usual: 0 to 0.5 mm2",
    0.0,
    (0.0, 5e-6),
)

FADING = Parameter(
    "leak_fading",
    "1",
    0.5,
    "how the leak combines with the opening: 0 adds to it, 1 combines as a radial clearance does (root of the sum "
    "of squares)",
    "geometry of a worn corner, and of a spool with clearance",
    0.0,
    (0.0, 1.0),
)
NONE = 1e-24  # m2: no leak


class ValveUnderlap(Effect):
    """Every edge opens about `width` earlier, so that both edges of a port are open in between, and leaks as well."""

    name = "valve_underlap"
    sites = ("flow.chamber_a", "flow.chamber_b")
    equation = "3-6"
    parameters = (WIDTH, AREA, FADING, *EDGES)
    strength = {"width": 1e-3, "null_leakage": 1e-8}
    usual = (
        {"width": 4e-3, "null_leakage": 0.0, "leak_fading": 0.5, **ALIKE},
        {"width": 0.02, "null_leakage": 0.0, "leak_fading": 0.5, **ALIKE},
        {"width": 0.0, "null_leakage": 1e-7, "leak_fading": 0.5, **ALIKE},
    )
    law = (
        "a chamber's edges open by z = W max(s + w, 0) to supply and W max(w - s, 0) to exhaust; with a leak A_0 each "
        "passes z + A_0, sqrt(z^2 + A_0^2), or a value in between"
    )
    says = (
        "the valve does not close: up to {width} of full command both supply and exhaust are open, and every edge "
        f"leaks through {{null_leakage}} (fading {{leak_fading}}); {SAID}"
    )
    depends_on = ("command", "pressure_a", "pressure_b")
    needs = "holds and slow motion with commands near zero"
    look_alikes = ("valve_deadband", "cross_leakage", "ambient_leakage", "tube_restriction", "valve_offset")
    excludes = ("valve_deadband",)
    experiment = "close the valve under pressure: underlap draws both chambers to the same pressure"
    source = "geometry of a spool that is narrower than its ports"

    def active_range(
        self, values: Mapping[str, float], plant: Mapping[str, float]
    ) -> Mapping[str, tuple[float, float]]:
        """Commands at which both edges of a port are open."""
        width = values["width"]
        return {"command": (-width, width)} if width > 0.0 else {}

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The flow into the chamber, kg/s, including that through edges that should be shut or less open."""
        early = sheet.param(WIDTH) * sheet.plant_param("spool_travel")
        way = 1 if site.endswith("a") else -1  # of the spool that opens this chamber to supply
        s, width = way * near["spool"], sheet.plant_param("port_width")
        leak, fading = sheet.param(AREA) / sheet.plant_param("discharge_coefficient"), sheet.param(FADING)

        def more(way_open: Any, sooner: Any) -> Any:
            """Additional area of an edge, m2, compared with an ideal spool."""
            opened = width * ca.fmax(way_open + sooner, 0)
            diagonal = ca.sqrt(opened**2 + leak**2 + NONE**2) - opened
            return opened - width * ca.fmax(way_open, 0) + leak + fading * (diagonal - leak)

        supply = more(s, early * edge(sheet, way, supply=True))
        exhaust = more(-s, early * edge(sheet, -way, supply=False))
        return nominal + supply * near["supply"] + exhaust * near["exhaust"]
