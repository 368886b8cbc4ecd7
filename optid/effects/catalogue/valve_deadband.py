"""A spool that overlaps its ports: small commands move no air."""

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
    0.01,
    "half the dead zone, as a share of full command",
    "usual: 0.2 to 5 %",
    0.0,
    (0.0, 0.5),
)
ROUNDING = Parameter(
    "rounding",
    "1",
    0.1,
    "distance over which an edge opens gradually, as a share of the width",
    "corners wear round",
    0.0,
    (0.0, 2.0),
)
TAIL = Parameter(
    "rounding_tail",
    "1",
    0.5,
    "how the gradual opening ends: 0 abruptly, as an arc does, 1 asymptotically",
    "corners wear round, in various shapes",
    0.0,
    (0.0, 1.0),
)
NONE = 1e-18  # m: no rounding


class ValveDeadband(Effect):
    """Each edge opens by the excess of the spool's travel z over its overlap; a round corner takes r of it in the end.

    It opens as a parabola up to z = 2 r and linearly beyond, as z^2 / (z + r), or as a curve in between.
    """

    name = "valve_deadband"
    sites = ("valve.spool", "flow.supply_area", "flow.exhaust_area")
    equation = "3-6"
    parameters = (WIDTH, ROUNDING, TAIL, *EDGES)
    strength = {"width": 1.5e-3}
    usual = tuple({"width": width, "rounding": 0.0, "rounding_tail": 0.5, **ALIKE} for width in (0.01, 0.04))
    law = "ports open by the amount that the spool's travel exceeds the overlap d, to each side"
    says = (
        "the valve's ports stay shut for the first {width} of full command to each side, and open gradually over "
        f"{{rounding}} of that (tail {{rounding_tail}}); {SAID}"
    )
    depends_on = ("command",)
    needs = "commands that pass slowly through zero"
    ahead_of = ("end_cushioning", "tube_restriction")
    look_alikes = ("valve_underlap", "valve_hysteresis", "stribeck_friction", "tube_restriction")
    excludes = ("valve_underlap",)
    experiment = "small steps of the command about zero at several pressures, with the pressures measured"
    source = "Tao, Meng and others, Math. Probl. Eng. 2034923, 2016"

    def active_range(
        self, values: Mapping[str, float], plant: Mapping[str, float]
    ) -> Mapping[str, tuple[float, float]]:
        """Commands at which the ports stay shut."""
        width = values["width"]
        return {"command": (-width, width)} if width > 0.0 else {}

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """Areas of the open ports, m2; the spool's travel is only stored."""
        if site == "valve.spool":
            return nominal
        spool, travel = near["spool"], sheet.plant_param("spool_travel")
        width = sheet.param(WIDTH) * travel
        way = ca.if_else(spool > 0, 1, -1)
        beyond = ca.fmax(ca.fabs(spool) - width * edge(sheet, way, supply=site == "flow.supply_area"), 0)
        lost, tail = sheet.param(ROUNDING) * width + NONE, sheet.param(TAIL)
        curved = ca.fmin(beyond, 2 * lost)
        arc = curved**2 / (4 * lost) + beyond - curved
        opened = (1 - tail) * arc + tail * beyond**2 / (beyond + lost)
        return nominal - sheet.plant_param("port_width") * (ca.fabs(spool) - opened)
