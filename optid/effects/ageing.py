"""A level that grows while a speed is zero and falls back in motion: a surrogate for ageing at rest."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.description import LEAST, OWN, POSITIVE, Description, constant, followed

TIMES = (0.1, 0.5, 2.0)  # s: start value of searches
FORGOTTEN = 2e-3  # s: time constant of its decay in motion


class Ageing(Description):
    """nominal * (1 + height * size * z) with z' = r (1 - z) / time - (1 - r) z / FORGOTTEN, r = 1 / (1 + (s / slow)^4).

    Args:
        site: site whose level ages; several are joined by "+", and each has its own age.
        signal: the speed s; after a "*" the signal whose magnitude multiplies the aged part.
        size: share that a height of 1 adds after a long rest.
        slow: speed below which it rests, in its SI unit.
        magnitude: usual magnitude of that signal, SI.

    Source: friction that grows with the time of contact, as Rabinowicz, Proceedings of the Physical Society 71, 1958.
    """

    kind = "ageing"
    needs = "rests of several lengths"

    def __init__(
        self, site: str, signal: str, *, size: float = 1.0, slow: float = 1.0, magnitude: float = 1.0
    ) -> None:
        super().__init__(site, signal, magnitude=magnitude, size=size, slow=slow)
        self.parameters = (
            constant("size", size, POSITIVE, "share that a height of 1 adds after a long rest"),
            constant("slow", slow, POSITIVE, f"{self.along} below which it rests, SI"),
            *self._magnitude,
            Parameter("height", "1", 1.0, "of the final value", OWN, 0.0),
            Parameter(
                "time", "s", 0.5, "time constant of the ageing", OWN, 0.5, (5e-3, 60.0), logarithmic=True
            ),
        )
        self.strength = {"height": LEAST}
        self.usual = tuple({"height": sign, "time": time} for time in TIMES for sign in (1.0, -1.0))
        self.law = f"a quantity that grows while {self.along.replace('_', ' ')} rests"
        self.says = f"{self.law} in {{time}}{self.swells}{self.describes}"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The aged level."""
        own = {q.name: sheet.param(q) for q in self.parameters}
        ratio = (followed(self.along, near, sheet) / own["slow"]) ** 2
        rests = 1 / (1 + ratio * ratio)
        age = sheet.state(f"age_{self.sites.index(site)}", "1", 0.3, spread=0.3)
        sheet.rate(age, rests * (1 - age) / own["time"] - (1 - rests) * age / FORGOTTEN)
        return nominal * (1 + self.swelled(own["height"] * own["size"] * age, near, sheet))
