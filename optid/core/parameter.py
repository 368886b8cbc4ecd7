"""A physical parameter: its name, unit, typical size and the bounds outside which it has no meaning."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Nuisance:
    """How a nuisance parameter is fitted together with the requested ones.

    Attributes
    ----------
    low, high : float
        within these bounds it belongs to the law; beyond them it is an effect worth a name.
    sd : float | None
        prior standard deviation about the stated or default value; ``None`` without a prior.
    by_filter : bool
        fitted only by filter methods: a smoother of short recordings does not converge with it.
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
        value when the rig file gives none; ``None`` makes it required.
    bounds : tuple[float, float]
        the closed interval outside which the value is meaningless.
    logarithmic : bool
        the fit uses log(value): for widths and rates known to a factor.
    fitted : bool
        whether a diagnosis fits it; false for parameters that only define others, like the ends of a curve.
    leeway : float
        tolerated deviation of the value, where the law is an approximation; errors within it do not count against a
        model.
    starts : tuple[float, ...]
        values at which searches begin, one after the other; the stated or default one if empty.
    nuisance : Nuisance | None
        how fits free it unless the rig file states it; ``None``: they do not.
    daily : float
        sd of its change from day to day without any wear, as a share of its value (a supply pressure, for example);
        estimates of single nights free it.
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
