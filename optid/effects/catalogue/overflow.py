"""An upper store that runs over at its rim, part of it into the lower one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.core.smooth import soft_floor
from optid.effects.effect import Effect

TANKS = "Schoukens, Mattsson, Wigren and Noel, cascaded tanks benchmark, 2016: the upper tank overflows"
WEIR = Parameter(
    "weir", "1/s", 0.3, "rate at which the level above the rim runs off", TANKS, 0.0, (0.0, 50.0)
)
RIM = Parameter("rim", "1", 5.0, "level of the rim, in the SI unit of the levels", TANKS, 9.0, (0.0, 1e3))
CAUGHT = Parameter(
    "caught",
    "1",
    0.5,
    "rise of the lower level per fall of the upper one by what runs over",
    TANKS,
    0.5,
    (0.0, 10.0),
)
ROUND = 0.01  # of the rim's level: half the range over which it begins; a quarter of it of error at most


class Overflow(Effect):
    """A flow weir max(level - rim, 0) out of the upper store, `caught` of it into the lower."""

    name = "overflow"
    sites = ("store.upper", "store.caught")
    equation = "balance of the upper store"
    parameters = (WEIR, RIM, CAUGHT)
    strength = {"weir": 0.01}
    usual = tuple(
        {"weir": 0.3, "rim": rim, "caught": caught} for rim in (6.0, 8.0, 10.0) for caught in (0.3, 0.9)
    )
    law = "weir (level - rim) runs over while the level stands above the rim"
    says = "the upper store runs over at {rim}, at {weir} per level above, and {caught} of it arrives in the lower one"
    depends_on = ("level",)
    needs = "levels up to the rim and beyond"
    look_alikes = ()
    experiment = "fill the upper store until it runs over, and look"
    source = TANKS

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """What leaves over the rim, and what of it is caught, in levels per second."""
        if site == "store.caught":
            return nominal * sheet.param(CAUGHT)
        rim = sheet.param(RIM)
        above = soft_floor(near["level"] - rim, 0, ROUND * (rim + 0.1))
        return nominal + sheet.param(WEIR) * above
