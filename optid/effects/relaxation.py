"""A relaxation at a site: a surrogate for physics with a memory."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.description import ANY, LEAST, OWN, POSITIVE, Description, constant, followed

TIMES = (0.02, 0.15, 1.0)  # s: start value of searches


class Relaxation(Description):
    """nominal - height * size * (s - z) / scale with z' = (s - z) / time: a change of s that decays.

    Args:
        site: site to which it adds; several are joined by "+", and each has its own memory.
        signal: the state or input s, or a signal declared at each site, as a chamber's own "P"; after a "*" the signal
            whose magnitude multiplies it.
        size: what a height of 1 adds, in the SI unit of the site, for a change of s by `scale`.
        scale: usual size of s, SI.
        start: of the memory, SI.
        magnitude: usual magnitude of the multiplying signal, SI.

    Source: Maxwell's element, in mechanics a spring and a damper in series.
    """

    kind = "relaxation"
    needs = "changes faster and slower than its time constant"

    def __init__(
        self,
        site: str,
        signal: str,
        *,
        size: float = 1.0,
        scale: float = 1.0,
        start: float = 0.0,
        magnitude: float = 1.0,
    ) -> None:
        super().__init__(site, signal, magnitude=magnitude, size=size, scale=scale, start=start)
        self.parameters = (
            constant("size", size, POSITIVE, "what a height of 1 adds at the site, in its SI unit"),
            constant("scale", scale, POSITIVE, f"usual size of {self.along}, SI"),
            constant("start", start, ANY, f"value of {self.along} at which the memory starts, SI"),
            *self._magnitude,
            Parameter("height", "1", 1.0, "of the relaxation", OWN, 0.0),
            Parameter(
                "time", "s", 0.15, "time constant of the decay", OWN, 0.15, (2e-3, 60.0), logarithmic=True
            ),
        )
        self.strength = {"height": LEAST}
        self.usual = tuple({"height": sign, "time": time} for time in TIMES for sign in (1.0, -1.0))
        self.law = f"a quantity that follows changes of {self.along.replace('_', ' ')} and decays"
        self.says = f"{self.law} in {{time}}{self.swells}{self.describes}"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The signal plus the relaxation."""
        own = {q.name: sheet.param(q) for q in self.parameters}
        signal = (followed(self.along, near, sheet) - own["start"]) / own["scale"]
        memory = sheet.state(f"memory_{self.sites.index(site)}", "1", 1.0, spread=1.0)
        sheet.rate(memory, (signal - memory) / own["time"])
        return nominal - self.swelled(own["height"] * own["size"] * (signal - memory), near, sheet)
