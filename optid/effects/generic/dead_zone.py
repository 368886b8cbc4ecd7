"""A signal that has no effect while it is small."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.core.smooth import dead_zone
from optid.effects.anywhere import Anywhere

WIDTH = Parameter(
    "width",
    "1",
    0.1,
    "half the dead zone, in the signal's SI unit",
    "small beside the signal",
    0.0,
    (0.0, math.inf),
)


class DeadZone(Anywhere):
    """The part of the signal beyond +-width."""

    kind = "dead_zone"
    parameters = (WIDTH,)
    along = ("width",)
    strength = {"width": 0.01}
    usual = ({"width": 0.05}, {"width": 0.2})
    law = "signal - width above width, signal + width below -width, zero between"
    says = "the signal has no effect up to {width}"
    needs = "signals that pass slowly through zero"
    experiment = "small steps about zero"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The rest of the signal."""
        return dead_zone(nominal, self.own(WIDTH, near, sheet))
