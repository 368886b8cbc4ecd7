"""Units and usual sizes of a plant's axis: laws stated for a slide of 0.1 m and 100 N are converted to them.

A law of friction or of a spring is the same for a slide and for a joint; for a joint "m" becomes "rad", "N" becomes "N
m", and usual sizes are scaled.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

from optid.core.parameter import Nuisance, Parameter

TRAVEL, EFFORT = 0.1, 100.0  # m, N: the slide for which laws are stated
_FACTOR = re.compile(r"(/?) ?\b([A-Za-z]+)(?:\*\*([\d.]+))?")
_LENGTH = re.compile(r"(\d+(?:\.\d+)?)(?: to (\d+(?:\.\d+)?))? (mm|m)\b")


@dataclass(frozen=True)
class Axis:
    """The unit of an axis's travel and of its effort, and a usual size of either, SI.

    Attributes
    ----------
    travel_unit : str
        "m" or "rad".
    travel : float
        usual half of its travel.
    effort_unit : str
        "N" or "N m".
    effort : float
        usual size of the driving force or torque.
    """

    travel_unit: str = "m"
    travel: float = TRAVEL
    effort_unit: str = "N"
    effort: float = EFFORT

    def length(self, value: float) -> float:
        """A length of the slide, m, scaled to this axis."""
        return value * (self.travel / TRAVEL)

    def factor(self, unit: str) -> float:
        """Scale factor of a quantity in a unit of the slide; 1 where the unit is not one of motion."""
        powers = _powers(unit)
        metres, newtons = powers.get("m", 0.0), powers.get("N", 0.0)
        return float((self.travel / TRAVEL) ** metres * (self.effort / EFFORT) ** newtons)

    def unit(self, unit: str) -> str:
        """A unit of the slide, converted to this axis: "N s/m" is "N m s/rad" on a joint."""
        if not _powers(unit):
            return unit
        moved = re.sub(r"\bm\b", self.travel_unit, unit)
        effort = self.effort_unit
        below = f"({effort})" if " " in effort else effort
        return re.sub(r"(/?)\bN\b", lambda found: f"/{below}" if found[1] else effort, moved)

    def sized(self, q: Parameter) -> Parameter:
        """A parameter of a law for the slide, with this axis's unit and sizes.

        Parameters
        ----------
        q : Parameter
            as the law states it.

        Returns
        -------
        Parameter
            the same, scaled by its dimension.
        """
        by = self.factor(q.unit)
        return replace(
            q,
            unit=self.unit(q.unit),
            typical=q.typical * by,
            default=None if q.default is None else q.default * by,
            bounds=(q.bounds[0] * by, q.bounds[1] * by),
            leeway=q.leeway * by,
            starts=tuple(start * by for start in q.starts),
            nuisance=q.nuisance and _grown(q.nuisance, by),
        )

    def words(self, text: str) -> str:
        """A text with its lengths converted to this axis: "0.1 m" is "1 rad" on a joint with ten times the travel."""

        def said(found: re.Match[str]) -> str:
            metres = 1e-3 if found[3] == "mm" else 1.0
            numbers = [f"{self.length(float(n) * metres):.3g}" for n in found.groups()[:2] if n]
            return f"{' to '.join(numbers)} {self.travel_unit}"

        return text if self.travel_unit == "m" else _LENGTH.sub(said, text)


# Of a joint whose plant states no axis: its angle tells the units of what effects add, but no sizes.
JOINT = Axis("rad", TRAVEL, "N m", EFFORT)


def _grown(n: Nuisance, by: float) -> Nuisance:
    return replace(n, low=n.low * by, high=n.high * by, sd=None if n.sd is None else n.sd * by)


def _powers(unit: str) -> dict[str, float]:
    """Exponents of N, m and s in a unit made of these only; none for areas, volumes and other quantities."""
    found: dict[str, float] = {}
    for slash, name, power in _FACTOR.findall(unit):
        found[name] = found.get(name, 0.0) + (-1.0 if slash else 1.0) * float(power or 1.0)
    solid = found.get("m", 0.0) >= 2.0 and "N" not in found
    return {} if solid or not found.keys() <= {"N", "m", "s"} else found
