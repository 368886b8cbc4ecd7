"""A signal that is a power of its nominal value."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.core.smooth import soft_power
from optid.effects.anywhere import Anywhere

EXPONENT = Parameter("exponent", "1", 0.3, "power of the signal", "square roots to squares", 1.0, (0.2, 4.0))
SMALL = 1e-3  # share of the signal's size below which the law is a line: its slope at zero stays finite


class PowerLaw(Anywhere):
    """size sign(s) |s / size|^n, the signal itself at n = 1 and where it has its usual size."""

    kind = "power_law"
    parameters = (EXPONENT,)
    strength = {"exponent": 0.05}
    usual = ({"exponent": 0.7}, {"exponent": 1.4})
    law = "the signal's magnitude is raised to the power n"
    says = "the signal acts with the power {exponent} of its magnitude"
    needs = "signals from small to their largest"
    experiment = "apply steps of widely different size"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The signal's power."""
        return near["size"] * soft_power(nominal / near["size"], self.own(EXPONENT, near, sheet), SMALL)
