"""A constant added to a signal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.anywhere import Anywhere

OFFSET = Parameter(
    "offset", "1", 0.1, "constant added, in the signal's SI unit", "small beside the signal", 0.0
)


class Offset(Anywhere):
    """signal + offset."""

    kind = "offset"
    parameters = (OFFSET,)
    along = ("offset",)
    strength = {"offset": 0.01}
    usual = ({"offset": 0.1}, {"offset": -0.1})
    law = "signal + offset"
    says = "a constant {offset} is added here"
    needs = "signals of different size"
    look_alikes = ("constant_force",)  # a drive whose command is a torque cannot tell one from the other
    experiment = "hold everything still and read the signal"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The signal plus the constant."""
        return nominal + self.own(OFFSET, near, sheet)
