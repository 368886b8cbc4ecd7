"""A curve drawn through what is missing at a site: a description for physics that has no name, and never a name itself.

It is no part of the catalogue. A rig file holds it as ``[effects."curve@SITE@SIGNAL"]``, or as
``[effects."curve@SITE@SIGNAL@SPEED"]`` where it turns its sign with a speed, as friction does. Sites that are alike, as
both chambers' flows, share one as ``SITE+SITE``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.anywhere import MARK
from optid.effects.effect import Effect

HEIGHTS = 13
LEAST = 0.1  # height: a tenth of what an unknown signal does at the site
OWN = "of the recordings it was fitted to"
AND = "+"  # between sites that share a description


class Curve(Effect):
    """nominal + size * sum of h_k B_k(signal), with B_k the cubic B-splines on even knots from `low` to `high`.

    Beyond its ends the curve goes on straight. With a speed it is multiplied by speed / sqrt(speed**2 + width**2).

    Args:
        site: where it adds; several are joined by "+".
        along: the state or input that it follows, or a signal that each of the sites knows, as a chamber's own "P".
        speed: the state with whose sign it turns; "" for none.
        low, high: ends of the curve, in the SI unit of `along`.
        size: what a height of 1 adds, in the SI unit of the site.
        width: of the turn, in the SI unit of `speed`.

    Source: de Boor, A Practical Guide to Splines, 1978, chapter IX.
    """

    kind = "curve"
    drawn = "curve"
    equation = "-"
    needs = "motion over the whole range"
    usual = ({},)
    entire = True
    source = "a description, not a law"

    def __init__(
        self,
        site: str,
        along: str,
        speed: str = "",
        *,
        low: float = 0.0,
        high: float = 1.0,
        size: float = 1.0,
        width: float = 1.0,
    ) -> None:
        self.name = MARK.join((self.kind, site, along, *([speed] if speed else [])))
        self.sites, self.along, self.speed = tuple(site.split(AND)), along, speed
        span, positive = (-math.inf, math.inf), (1e-300, math.inf)
        constants = [("low", low, span, f"lower end of the curve, {OWN}")]
        constants += [("high", high, span, f"upper end of the curve, {OWN}")]
        constants += [("size", size, positive, "what a height of 1 adds at the site, in its SI unit")]
        constants += [("width", width, positive, "speed at which it has turned by 71 %")] if speed else []
        self.parameters = tuple(
            Parameter(name, "1", 1.0, about, OWN, value, bounds, fitted=False)
            for name, value, bounds, about in constants
        ) + tuple(
            Parameter(f"height_{k + 1}", "1", 1.0, "weight of a B-spline", OWN, 0.0) for k in range(HEIGHTS)
        )
        self.strength = dict.fromkeys((q.name for q in self.fitted), LEAST)
        self.depends_on = (along, speed) if speed else (along,)
        turned = f" against the direction of {speed.replace('_', ' ')}" if speed else ""
        self.law = f"a {self.drawn} over {along.replace('_', ' ')}{turned}"
        self.says = f"{self.law} describes it"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The signal with the curve on top."""
        return nominal + self.height(near, sheet)

    def height(self, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """Of the curve where its signal is."""
        own = {q.name: sheet.param(q) for q in self.parameters}
        share = (followed(self.along, near, sheet) - own["low"]) / (own["high"] - own["low"])
        held = ca.fmin(ca.fmax(share, 0.0), 1.0)
        knot, beyond = held * (HEIGHTS - 3), (share - held) * (HEIGHTS - 3)
        curve = own["size"] * sum(
            own[f"height_{k + 1}"] * (_spline(knot - (k - 1)) + beyond * _slope(knot - (k - 1)))
            for k in range(HEIGHTS)
        )
        if self.speed:
            v = sheet.signal(self.speed)
            curve *= v / ca.sqrt(v**2 + own["width"] ** 2)
        return curve


class Scaling(Curve):
    """nominal * (1 + the curve): what passes, as a share that a signal changes."""

    kind = "scaling"
    drawn = "share"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The signal, scaled."""
        return nominal * (1 + self.height(near, sheet))


def followed(along: str, near: Mapping[str, Any], sheet: Sheet) -> Any:
    """A signal that a site knows by that name, or else the plant."""
    return near[along] if along in near else sheet.signal(along)


def _spline(t: Any) -> Any:
    """The cubic B-spline about 0 on whole knots."""
    d = ca.fabs(t)
    return (ca.fmax(2.0 - d, 0.0) ** 3 - 4.0 * ca.fmax(1.0 - d, 0.0) ** 3) / 6.0


def _slope(t: Any) -> Any:
    """Its derivative."""
    d = ca.fabs(t)
    return ca.sign(t) * (2.0 * ca.fmax(1.0 - d, 0.0) ** 2 - ca.fmax(2.0 - d, 0.0) ** 2 / 2.0)
