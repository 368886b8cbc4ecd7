"""Effects for any site: named "saturation@flow.inlet" when they act at `flow.inlet`.

Their laws use only the usual size of the signal, which the plant states at the site. Lengths along the signal are in
its SI unit; a rig file gives them as plain numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

MARK = "@"


class Anywhere(Effect):
    """An effect constructed for a site; a subclass writes its sizes for a signal of usual size 1.

    Args:
        place: the site.
        size: usual size of the signal there, SI.

    Attributes:
        kind: its name without the site.
        along: names of the parameters measured along the signal, which scale with its size.
    """

    kind: str
    along: tuple[str, ...] = ()
    equation = "-"
    depends_on = ("signal",)
    source = "a law that fits any signal"

    def __init__(self, place: str, size: float = 1.0) -> None:
        self.name, self.sites = f"{self.kind}{MARK}{place}", (place,)
        self.parameters = tuple(self._sized(q, size) for q in self.parameters)
        self.strength = self._grown(self.strength, size)
        self.usual = tuple(self._grown(point, size) for point in self.usual)

    @classmethod
    def suits(cls, place: str) -> bool:
        """Whether it can act at a site of this name; any, unless a kind restricts it."""
        return True

    @property
    def site(self) -> str:
        """Where it acts, in full."""
        return self.sites[0]

    def own(self, parameter: Parameter, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """A parameter on the sheet, scaled by the size that the plant states at the site."""
        return sheet.param(self._sized(parameter, near["size"]))

    def _sized(self, q: Parameter, size: float) -> Parameter:
        if q.name not in self.along:
            return q
        return replace(q, typical=q.typical * size, default=None if q.default is None else q.default * size)

    def _grown(self, values: Mapping[str, float], size: float) -> dict[str, float]:
        return {name: value * size if name in self.along else value for name, value in values.items()}
