"""A signal that grows less, or no more, beyond some size."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.core.smooth import dead_zone
from optid.effects.anywhere import Anywhere

LOSS = Parameter(
    "loss",
    "1",
    0.5,
    "share of the signal beyond the limit that is lost; 1 is a hard stop",
    "from nothing to all of it",
    0.0,
    (0.0, 1.0),
)
LIMIT = Parameter(
    "limit",
    "1",
    1.0,
    "size of the signal beyond which it saturates, in its SI unit",
    "within its range",
    1.0,
    (0.0, math.inf),
)


class Saturation(Anywhere):
    """A bend at +-limit."""

    kind = "saturation"
    parameters = (LOSS, LIMIT)
    along = ("limit",)
    strength = {"loss": 0.1}
    usual = tuple({"loss": 0.8, "limit": limit} for limit in (0.4, 0.7, 1.0, 1.5))
    law = "beyond +-limit only (1 - loss) of the signal is left"
    says = "beyond {limit} a share of {loss} of the signal is lost"
    needs = "signals from small to their largest"
    experiment = "repeat the same signal at rising amplitude"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The saturated signal."""
        return nominal - self.own(LOSS, near, sheet) * dead_zone(nominal, self.own(LIMIT, near, sheet))
