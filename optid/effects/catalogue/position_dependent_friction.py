"""Dry friction that depends on position: a dent, a dry patch, a jamming guide."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

RISE = Parameter(
    "rise",
    "1",
    0.3,
    "dry friction added at the place, as a share of the dry friction far from it",
    "usual: 5 to 50 %",
    0.0,
    (-0.95, 10.0),
)
PLACE = Parameter(
    "place",
    "m",
    0.05,
    "position of the place, from mid-stroke",
    "anywhere along the stroke, or beyond it for a slope",
    0.0,
    (-1.0, 1.0),
)
WIDTH = Parameter(
    "width",
    "m",
    0.03,
    "distance over which the change dies away",
    "usual: 5 to 40 mm, or the stroke",
    0.03,
    (3e-3, 2.0),
    logarithmic=True,
)
ENDING = Parameter(
    "ending",
    "1",
    3.0,
    "shape of the change: 2 is an arch with an edge, 50 a bell without one",
    "a damaged patch has an edge, a misaligned guide has none",
    50.0,
    (2.0, 50.0),
    logarithmic=True,
)
SLOPES = {
    name: Parameter(
        name,
        "1/m",
        1.0,
        f"dry friction added per metre {words} the place, as a share of that near it",
        "guides that are not parallel: 5 to 50 % over half a stroke",
        0.0,
        (-15.0, 15.0),
    )
    for name, words in (("slope_ahead", "ahead of"), ("slope_behind", "behind"))
}
# Searches start from nearly a bell: a patch with an edge has no slope outside it.
SHAPE = {"ending": 20.0, **dict.fromkeys(SLOPES, 0.0)}
BASE = 1e-9  # of a power: zero beyond the edge, with finite slopes there


class PositionDependentFriction(Effect):
    """F_r (1 + r max(1 - z^2/n, 0)^n + s max(x - x_0, 0) + t max(x_0 - x, 0)), z = (x - x_0)/w.

    One maximum or minimum of free place and width: narrow for a bump, as wide as the stroke for friction that grows
    towards both ends (a minimum at mid-stroke) or towards one (a maximum at that end). The power n sets its shape:
    it ends at an edge sqrt(n) widths away; for large n it is the bell exp(-z^2) without an edge. From the same
    place it may also rise linearly in both directions, as with guides that are not parallel.
    """

    name = "position_dependent_friction"
    sites = ("force.coulomb",)
    equation = "11"
    parameters = (RISE, PLACE, WIDTH, ENDING, *SLOPES.values())
    strength = {"rise": 0.05, "slope_ahead": 0.5, "slope_behind": 0.5}
    usual = tuple(
        {"rise": rise, "place": place, "width": width, **SHAPE}
        for rise in (0.3, -0.2)
        for place, width in (
            (-0.08, 0.025),
            (-0.04, 0.025),
            (0.0, 0.025),
            (0.04, 0.025),
            (0.08, 0.025),
            (0.0, 0.08),
            (-0.1, 0.1),
            (0.1, 0.1),
        )
    ) + tuple(
        {"rise": 0.0, "place": place, "width": 0.03, **SHAPE, slope: much}
        for slope, place in zip(SLOPES, (-0.03, 0.03), strict=True)
        for much in (3.0, -2.0)
    )
    law = "dry friction is F_r (1 + r max(1 - ((x - x_0) / w)^2 / n, 0)^n + s max(x - x_0, 0) + t max(x_0 - x, 0))"
    says = (
        "dry friction changes along the stroke by {rise} around {place}, over {width} to each side (ending "
        "{ending}: 2 an arch with an edge, 50 a bell without one), and linearly by {slope_ahead} ahead of it and "
        "{slope_behind} behind it"
    )
    depends_on = ("position", "velocity")
    places = ("position",)
    needs = "motion over the whole stroke in both directions"
    ahead_of = ("presliding",)
    look_alikes = (
        "spring_load",
        "sensor_nonlinearity",
        "critical_pressure_ratio",
        "friction_drift",
        "end_cushioning",
    )
    experiment = (
        "pass the place in both directions at two speeds: a spring would help in one direction, friction "
        "hinders in both"
    )
    source = "Coulomb friction that changes along the stroke"

    def active_range(
        self, values: Mapping[str, float], plant: Mapping[str, float]
    ) -> Mapping[str, tuple[float, float]]:
        """The place, as far as a tenth of the bump is left; to one end, where friction rises that way."""
        place, n = values["place"], values["ending"]
        wide = values["width"] * math.sqrt(n * (1.0 - 0.1 ** (1.0 / n)))
        acts = {name: abs(values[name]) >= least for name, least in self.strength.items()}
        low = -math.inf if acts["slope_behind"] else place - wide if acts["rise"] else place
        high = math.inf if acts["slope_ahead"] else place + wide if acts["rise"] else place
        return {"position": (low, high)} if low < high and math.isfinite(max(low, -high)) else {}

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The level of dry friction, N, at the place of the contact."""
        off = near["x"] - sheet.param(PLACE)
        power = sheet.param(ENDING)
        change = sheet.param(RISE) * ca.fmax(1 - (off / sheet.param(WIDTH)) ** 2 / power, BASE) ** power
        for slope, way in zip(SLOPES.values(), (off, -off), strict=True):
            change += sheet.param(slope) * ca.fmax(way, 0)
        return nominal * ca.fmax(1 + change, 0)
