"""Surrogates for a mismatch that no named effect explains: functions of signals that act at sites.

They are not part of the catalogue. A rig file stores one as ``[effects."KIND@SITE@SIGNAL"]``. Similar sites, as both
chambers' flows, share one as ``SITE+SITE``; a form multiplied by the magnitude of another signal has that after the
first, as ``SIGNAL*OTHER``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Self

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.anywhere import MARK
from optid.effects.effect import Effect

LEAST = 0.1  # height: a tenth of the unknown input at the site
OWN = "of the recordings it was fitted to"
AND, TIMES = "+", "*"  # between sites that share a description, and before the multiplying signal
POSITIVE, ANY = (1e-300, math.inf), (-math.inf, math.inf)


class Description(Effect):
    """A function of a signal; a subclass has `kind`, its parameters and its action at a site.

    Attributes:
        kind: its name without the places.
        adds: it is additive, possibly multiplied by another signal.
        along: the state or input on which it depends, or a signal declared at each of its sites, as a chamber's own
            "P".
        by: the signal whose magnitude multiplies it; "" for none.
    """

    kind: str
    adds = True
    equation = "-"
    entire = True
    source = "a description, not a law"

    def __init__(self, site: str, signal: str, *turn: str, magnitude: float, **given: float) -> None:
        self.name = MARK.join((self.kind, site, signal, *turn))
        self.sites = tuple(site.split(AND))
        self.along, _, self.by = signal.partition(TIMES)
        self.depends_on = tuple(dict.fromkeys(name for name in (self.along, *turn, self.by) if name))
        self._turn = turn
        self._given: dict[str, Any] = {"magnitude": magnitude, **given}
        about = f"usual magnitude of {self.by}, SI"
        self._magnitude = (constant("magnitude", magnitude, POSITIVE, about),) if self.by else ()

    def over(self, signal: str, **other: float) -> Self:
        """The same over another signal, with other arguments of its constructor."""
        return type(self)(AND.join(self.sites), signal, *self._turn, **{**self._given, **other})

    def swelling(self, by: str, magnitude: float) -> Self:
        """The same, multiplied by the magnitude of a signal with this usual size, SI."""
        return self.over(f"{self.along}{TIMES}{by}", magnitude=magnitude)

    @property
    def swells(self) -> str:
        """The multiplying signal, as the end of its name."""
        return f", in proportion to the magnitude of {self.by.replace('_', ' ')}" if self.by else ""

    @property
    def describes(self) -> str:
        """The end of its sentence."""
        return f"{',' if self.by else ''} describes it"

    def swelled(self, value: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The added term, multiplied by the other signal's magnitude."""
        if not self.by:
            return value
        return value * ca.fabs(followed(self.by, near, sheet)) / sheet.param(*self._magnitude)


def constant(name: str, value: float, bounds: tuple[float, float], about: str) -> Parameter:
    """A parameter computed from the recordings and not fitted."""
    return Parameter(name, "1", 1.0, about, OWN, value, bounds, fitted=False)


def followed(along: str, near: Mapping[str, Any], sheet: Sheet) -> Any:
    """A signal declared at a site under that name, or else in the plant."""
    return near[along] if along in near else sheet.signal(along)
