"""An upper store that overflows at its rim, partly into the lower one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

TANKS = "Schoukens, Mattsson, Wigren and Noel, cascaded tanks benchmark, 2016: the upper tank overflows"
SPILLED = Parameter(
    "spilled",
    "1",
    0.5,
    "share of the surplus inflow that runs over when the store is full; 1 when it holds no more",
    TANKS,
    0.0,
    (0.0, 1.0),
)
RIM = Parameter("rim", "1", 5.0, "level of the rim, in the SI unit of the levels", TANKS, 9.0, (0.0, 1e3))
HEAD = Parameter(
    "head",
    "1",
    0.3,
    "rise above the rim at which that share is reached, in the SI unit of the levels",
    "a weir needs some head",
    0.3,
    (0.03, 100.0),
    logarithmic=True,
)
CAUGHT = Parameter(
    "caught",
    "1",
    0.5,
    "rise of the lower level per fall of the upper one, by the overflow",
    TANKS,
    0.5,
    (0.0, 10.0),
)


class Overflow(Effect):
    """The share `spilled` of the inflow to the upper store overflows; it is reached within `head` above the rim."""

    name = "overflow"
    sites = ("store.upper", "store.caught")
    equation = "balance of the upper store"
    parameters = (SPILLED, RIM, HEAD, CAUGHT)
    strength = {"spilled": 0.1}
    usual = tuple(
        {"spilled": 0.9, "rim": rim, "head": 0.5, "caught": caught}
        for rim in (6.0, 8.0, 10.0, 13.0)
        for caught in (0.3, 0.9)
    )
    law = "of the inflow that would raise a store full to the rim, the share s runs over"
    says = (
        "the upper store runs over at {rim}: {spilled} of the surplus inflow once the level is {head} above the "
        "rim, of which {caught} arrives in the lower store"
    )
    depends_on = ("level",)
    needs = "levels up to the rim and beyond"
    experiment = "fill the upper store until it runs over, and watch"
    source = TANKS

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The overflow and the part of it that is caught, in levels per second."""
        if site == "store.caught":
            return nominal * sheet.param(CAUGHT)
        depth = (near["level"] - sheet.param(RIM)) / sheet.param(HEAD)
        inside = ca.fmin(ca.fmax(depth, 0), 1)
        share = inside**2 * (3 - 2 * inside)
        return nominal + sheet.param(SPILLED) * share * ca.fmax(near["fill"], 0)
