"""A relaxation at a site: a description for physics with a memory that has no name, and never a name itself.

It is no part of the catalogue. A rig file holds it as ``[effects."relaxation@SITE@SIGNAL"]``; sites that are alike, as
both chambers' flows, share one as ``SITE+SITE``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.anywhere import MARK
from optid.effects.curve import AND, LEAST, OWN, followed
from optid.effects.effect import Effect

TIMES = (0.02, 0.15, 1.0)  # s: where searches begin


class Relaxation(Effect):
    """nominal - height * size * (s - z) / scale with z' = (s - z) / time: what a change of s causes and time forgets.

    Args:
        site: where it adds; several are joined by "+", and each has a memory of its own.
        along: the state or input s, or a signal that each of the sites knows, as a chamber's own "P".
        size: what a height of 1 adds, in the SI unit of the site, where s is off by `scale`.
        scale: usual size of s, SI.
        start: of the memory, SI.

    Source: Maxwell's element, in mechanics a spring and a damper in series.
    """

    kind = "relaxation"
    equation = "-"
    needs = "changes faster and slower than its time"
    entire = True
    source = "a description, not a law"

    def __init__(
        self, site: str, along: str, *, size: float = 1.0, scale: float = 1.0, start: float = 0.0
    ) -> None:
        self.name = MARK.join((self.kind, site, along))
        self.sites, self.along = tuple(site.split(AND)), along
        positive = (1e-300, math.inf)
        constants = [
            ("size", size, positive, "what a height of 1 adds at the site, in its SI unit"),
            ("scale", scale, positive, f"usual size of {along}, SI"),
            ("start", start, (-math.inf, math.inf), f"where the memory of {along} begins, SI"),
        ]
        self.parameters = (
            *(Parameter(name, "1", 1.0, about, OWN, value, bounds, fitted=False)
              for name, value, bounds, about in constants),
            Parameter("height", "1", 1.0, "of the relaxation", OWN, 0.0),
            Parameter("time", "s", 0.15, "in which it is forgotten", OWN, 0.15, (2e-3, 60.0), logarithmic=True),
        )  # fmt: skip
        self.strength = {"height": LEAST}
        self.usual = tuple({"height": sign, "time": time} for time in TIMES for sign in (1.0, -1.0))
        self.depends_on = (along,)
        self.law = f"what follows changes of {along.replace('_', ' ')} and is forgotten"
        self.says = f"{self.law} in {{time}} describes it"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The signal with the relaxation on top."""
        own = {q.name: sheet.param(q) for q in self.parameters}
        signal = (followed(self.along, near, sheet) - own["start"]) / own["scale"]
        memory = sheet.state(f"memory_{self.sites.index(site)}", "1", 1.0, spread=1.0)
        sheet.rate(memory, (signal - memory) / own["time"])
        return nominal - own["height"] * own["size"] * (signal - memory)
