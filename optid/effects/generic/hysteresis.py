"""A signal with hysteresis: it stops short of its nominal value, from both sides."""

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
    0.05,
    "half the hysteresis, in the signal's SI unit",
    "small beside the signal",
    0.0,
    (0.0, math.inf),
)


class Hysteresis(Anywhere):
    """The play operator; its state relaxes within a sample."""

    kind = "hysteresis"
    parameters = (WIDTH,)
    along = ("width",)
    strength = {"width": 0.01}
    usual = ({"width": 0.05}, {"width": 0.2})
    law = "the signal lags by the width and does not change while a reversal takes it up"
    says = "the signal has a hysteresis of {width} to each side"
    needs = "reversals"
    experiment = "apply triangles at two rates: hysteresis does not depend on the rate"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The signal after the play."""
        memory = sheet.state("memory", "1", near["size"], spread=2 * near["size"])
        beyond = dead_zone(nominal - memory, self.own(WIDTH, near, sheet))
        sheet.rate(memory, beyond / sheet.interval())
        return memory + beyond
