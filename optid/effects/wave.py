"""A wave that goes on by itself at a site: a description for physics that has no name, and never a name itself.

It is no part of the catalogue. A rig file holds it as ``[effects."wave@SITE@SIGNAL"]``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.anywhere import MARK
from optid.effects.curve import LEAST, OWN
from optid.effects.effect import Effect

TIME = "time"
SPREAD = 1.0  # of the height: by how much a recording's quadratures may differ from the mean phase's


class Wave(Effect):
    """nominal + size * height * sin(2 pi repeats * signal + phase).

    Over time, no two recordings begin alike: what of either quadrature is a recording's own are states that stand
    still, in which the wave is linear, so that a filter finds them from any start.

    Args:
        site: where it adds.
        along: the state or input that it follows, or "time".
        repeats: periods by the SI unit of `along` where a search begins.
        size: what a height of 1 adds, in the SI unit of the site.

    Source: Fourier; for unknown phases as states, Franklin, Powell and Workman, Digital Control of Dynamic Systems,
    section 8.5.2.
    """

    kind = "wave"
    equation = "-"
    needs = "several of its periods"
    entire = True
    source = "a description, not a law"

    def __init__(self, site: str, along: str, *, repeats: float = 1.0, size: float = 1.0) -> None:
        self.name = MARK.join((self.kind, site, along))
        self.sites, self.along = (site,), along
        self.parameters = (
            Parameter(
                "size", "1", 1.0, "what a height of 1 adds at the site, in its SI unit", OWN, size,
                (1e-300, math.inf), fitted=False,
            ),
            Parameter("height", "1", 1.0, "amplitude", OWN, 0.0),
            Parameter(
                "repeats", "1", repeats, f"periods by the SI unit of {along}", OWN, repeats, (1e-9, 1e9),
                logarithmic=True,
            ),
            Parameter("phase", "1", 1.0, "where the signal is 0, rad; over time the recordings' mean", OWN, 0.0),
        )  # fmt: skip
        self.strength = {"height": LEAST}
        self.usual = ({"height": 1.0},)
        self.depends_on = (along,)
        self.law = f"a wave over {along.replace('_', ' ')}"
        often = "of {repeats} Hz" if along == TIME else "with {repeats} periods in its SI unit"
        self.says = f"{self.law} {often} describes it"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The signal with the wave on top."""
        own = {q.name: sheet.param(q) for q in self.parameters}
        a, b = ca.cos(own["phase"]), ca.sin(own["phase"])
        if self.along == TIME:
            sine, cosine = (sheet.state(name, "1", 0.3, spread=SPREAD) for name in ("sine", "cosine"))
            for standing in (sine, cosine):
                sheet.rate(standing, 0.0)
            a, b = a + sine, b + cosine
            signal = sheet.clock()
        else:
            signal = sheet.signal(self.along)
        turns = 2 * math.pi * own["repeats"] * signal
        return nominal + own["size"] * own["height"] * (a * ca.sin(turns) + b * ca.cos(turns))
