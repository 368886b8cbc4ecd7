"""A spring that hardens or softens with its deflection."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.anywhere import Anywhere

HARDENING = Parameter(
    "hardening",
    "1",
    0.3,
    "share by which it is stronger than Hooke's law, at the site's usual size",
    "a beam under tension, a rubber stop; negative for a softening spring",
    0.0,
    (-0.3, 10.0),
)


class HardeningSpring(Anywhere):
    """s (1 + h (s / size)^2), Duffing's cubic law, for a spring's force or the deflection that represents it."""

    kind = "hardening_spring"
    parameters = (HARDENING,)
    # At three times its usual size, where signals peak, that is one percent.
    strength = {"hardening": 0.001}
    usual = ({"hardening": 0.15}, {"hardening": 0.02}, {"hardening": -0.02})
    law = "the spring's force is s (1 + h (s / size)^2), with s from Hooke's law"
    says = "the spring is {hardening} stronger than Hooke's law where its signal has its usual size"
    needs = "small and large deflections"
    experiment = "a slow sweep through the resonance at two amplitudes: it bends towards higher frequencies"
    source = "Duffing's oscillator, as in Wigren and Schoukens, European Control Conference 2013"

    @classmethod
    def suits(cls, place: str) -> bool:
        """Whether the plant names the site a spring's: "force.spring", "spring.force"."""
        return "spring" in place.split(".")

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The force with its cubic term."""
        return nominal * (1 + self.own(HARDENING, near, sheet) * (nominal / near["size"]) ** 2)
