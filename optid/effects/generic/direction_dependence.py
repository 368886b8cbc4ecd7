"""A signal with a different gain for each sign."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.anywhere import Anywhere

DIFFERENCE = Parameter(
    "difference",
    "1",
    0.1,
    "(gain for positive - for negative signals) over their sum",
    "some per cent",
    0.0,
    (-1.0, 1.0),
)


class DirectionDependence(Anywhere):
    """s + d |s|."""

    kind = "direction_dependence"
    parameters = (DIFFERENCE,)
    strength = {"difference": 0.02}
    usual = ({"difference": 0.15}, {"difference": -0.15})
    law = "gain 1 + d for positive and 1 - d for negative signals"
    says = "the gain is {difference} larger than the mean for positive signals and as much smaller for negative ones"
    needs = "signals of both signs"
    experiment = "apply equal steps in both directions"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The signal with a gain for each sign."""
        return nominal + self.own(DIFFERENCE, near, sheet) * ca.fabs(nominal)
