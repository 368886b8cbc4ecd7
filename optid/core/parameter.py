"""A physical parameter: its name, unit, typical size and the bounds outside which it has no meaning."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Nuisance:
    """How a nuisance parameter is fitted beside those that are asked for.

    Attributes
    ----------
    low, high : float
        between these it is a matter of the law; beyond them it is physics worth a name.
    sd : float | None
        of what is known before, about the stated or default value; ``None``: nothing.
    by_filter : bool
        freed where fits are by filter only: a smoother of short recordings loses its way in it.
    """

    low: float = -math.inf
    high: float = math.inf
    sd: float | None = None
    by_filter: bool = False


@dataclass(frozen=True)
class Parameter:
    """A named physical constant of a plant or an effect; every number is in SI units.

    Attributes
    ----------
    name : str
        as it stands in a rig file.
    unit : str
        SI unit in pint's notation (``"N s/m"``, ``"1"`` for a pure number).
    typical : float
        a usual size (> 0), which scales the fit; no start value.
    about : str
        one line for people.
    source : str
        equation, table, standard or data sheet the number comes from.
    default : float | None
        value when a rig file is silent; ``None`` makes it required.
    bounds : tuple[float, float]
        the closed interval outside which the value is meaningless.
    logarithmic : bool
        the fit moves log(value): for widths and rates known to a factor.
    fitted : bool
        an effect's are fitted where it is missing, unless they only say what the others mean, like the ends of
        a curve.
    leeway : float
        by how much the value may be off before anyone would call it physics, where a law stands in for
        nature's; what that changes is no mark against a model.
    starts : tuple[float, ...]
        values at which searches begin, one after the other; the stated or default one if empty.
    nuisance : Nuisance | None
        how fits free it unless the rig file states it; ``None``: they do not.
    daily : float
        share of its value (sd) by which it moves from day to day on a sound rig, as a supply's pressure does; what is
        estimated night by night frees it.
    """

    name: str
    unit: str
    typical: float
    about: str
    source: str
    default: float | None = None
    bounds: tuple[float, float] = (-math.inf, math.inf)
    logarithmic: bool = False
    fitted: bool = True
    leeway: float = 0.0
    starts: tuple[float, ...] = ()
    nuisance: Nuisance | None = None
    daily: float = 0.0

    def __post_init__(self) -> None:
        low, high = self.bounds
        if not self.typical > 0:
            raise ValueError(f"{self.name}: typical size must be positive, not {self.typical}")
        if not low < high:
            raise ValueError(f"{self.name}: bounds {self.bounds} are empty")
        if self.logarithmic and not low > 0:
            raise ValueError(f"{self.name}: a logarithmic parameter needs a positive lower bound")
        if self.default is not None and not low <= self.default <= high:
            raise ValueError(f"{self.name}: default {self.default} lies outside {self.bounds}")
