"""A curve fitted to the missing signal at a site, or to the share that passes.

A curve whose sign follows a speed, as friction's does, is stored in a rig file as
``[effects."curve@SITE@SIGNAL@SPEED"]``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Self

import casadi as ca
import numpy as np

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.description import ANY, LEAST, OWN, POSITIVE, TIMES, Description, constant, followed

HEIGHTS = 13
BENDS = 5  # number of shapes of a curve for proposals, Legendre polynomials: a constant, a slope, and bends


class Curve(Description):
    """nominal + size * sum of h_k B_k(signal), with B_k the cubic B-splines on even knots from `low` to `high`.

    Beyond its ends the curve is a straight line. With a speed it is multiplied by speed / sqrt(speed**2 + width**2).

    Args:
        site: site to which it adds; several are joined by "+".
        signal: the state or input on which it depends, or a signal declared at each site, as a chamber's own "P";
            after a "*" the signal whose magnitude multiplies it.
        speed: the state whose sign it follows; "" for none.
        low, high: ends of the curve, in the SI unit of its signal.
        size: what a height of 1 adds, in the SI unit of the site.
        width: of the change of sign, in the SI unit of `speed`.
        magnitude: usual magnitude of the multiplying signal, SI.

    Source: de Boor, A Practical Guide to Splines, 1978, chapter IX.
    """

    kind = "curve"
    drawn = "curve"
    needs = "motion over the whole range"
    usual = ({},)
    ways = tuple(
        {f"height_{k + 1}": float(height) for k, height in enumerate(shape)}
        for shape in np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, HEIGHTS), BENDS - 1).T
    )

    def __init__(
        self,
        site: str,
        signal: str,
        speed: str = "",
        *,
        low: float = 0.0,
        high: float = 1.0,
        size: float = 1.0,
        width: float = 1.0,
        magnitude: float = 1.0,
    ) -> None:
        turn = [speed] if speed else []
        given = {"low": low, "high": high, "size": size, **({"width": width} if speed else {})}
        super().__init__(site, signal, *turn, magnitude=magnitude, **given)
        self.speed = speed
        turned_at = constant("width", width, POSITIVE, "speed at which its sign has changed by 71 %")
        self.parameters = (
            constant("low", low, ANY, "lower end of the curve"),
            constant("high", high, ANY, "upper end of the curve"),
            constant("size", size, POSITIVE, "what a height of 1 adds at the site, in its SI unit"),
            *([turned_at] if speed else []),
            *self._magnitude,
            *(
                Parameter(f"height_{k + 1}", "1", 1.0, "weight of a B-spline", OWN, 0.0)
                for k in range(HEIGHTS)
            ),
        )
        self.strength = dict.fromkeys((q.name for q in self.fitted), LEAST)
        turned = f" against the direction of {speed.replace('_', ' ')}" if speed else ""
        self.law = f"a {self.drawn} over {self.along.replace('_', ' ')}{turned}{self.swells}"
        self.says = f"{self.law}{self.describes}"

    def turned(self, low: float, high: float, magnitude: float) -> Self:
        """The same with both signals exchanged: over the multiplying one, between its ends, multiplied by the other."""
        return self.over(f"{self.by}{TIMES}{self.along}", low=low, high=high, magnitude=magnitude)

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The signal plus the curve."""
        return nominal + self.height(near, sheet)

    def height(self, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The curve at the present value of its signal."""
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
        return self.swelled(curve, near, sheet)


class Scaling(Curve):
    """nominal * (1 + the curve): a share that depends on a signal."""

    kind = "scaling"
    drawn = "share"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The signal, scaled."""
        return nominal * (1 + self.height(near, sheet))


def _spline(t: Any) -> Any:
    """The cubic B-spline centred at 0 with integer knots."""
    d = ca.fabs(t)
    return (ca.fmax(2.0 - d, 0.0) ** 3 - 4.0 * ca.fmax(1.0 - d, 0.0) ** 3) / 6.0


def _slope(t: Any) -> Any:
    """Its derivative."""
    d = ca.fabs(t)
    return ca.sign(t) * (2.0 * ca.fmax(1.0 - d, 0.0) ** 2 - ca.fmax(2.0 - d, 0.0) ** 2 / 2.0)
