"""A sustained oscillation at a site: a surrogate for periodic signals."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Self

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.description import LEAST, OWN, POSITIVE, TIMES, Description, constant, followed

TIME = "time"
KNOTS = tuple(0.25 * k for k in range(11))  # in usual magnitudes of the signal on which the amplitude depends
LEAST_REPEATS = 1e-9  # per SI unit, of one that is read from a rig file
SPREAD = 1.0  # of the height: sd of a recording's own quadratures about the mean


class Wave(Description):
    """nominal + size * height * sin(2 pi repeats * signal + phase).

    Over time, recordings differ in phase: each recording's own part of both quadratures is a constant state; the wave
    is linear in it, so that a filter finds it from any start. Where the amplitude depends on another signal, it is
    interpolated through heights at KNOTS of that signal's usual magnitude, and constant beyond.

    Args:
        site: site to which it adds.
        signal: the state or input of its argument, or "time"; after a "*" the signal on whose magnitude its amplitude
            depends.
        repeats: periods per SI unit of its argument, as the start value of a search.
        size: what a height of 1 adds, in the SI unit of the site.
        magnitude: usual magnitude of that signal, SI.
        fewest: smallest number of periods per unit: at least one within the recorded range.

    Source: Fourier; for unknown phases as states, Franklin, Powell and Workman, Digital Control of Dynamic Systems,
    section 8.5.2.
    """

    kind = "wave"
    needs = "several of its periods"

    def __init__(
        self,
        site: str,
        signal: str,
        *,
        repeats: float = 1.0,
        size: float = 1.0,
        magnitude: float = 1.0,
        fewest: float = LEAST_REPEATS,
    ) -> None:
        super().__init__(site, signal, magnitude=magnitude, repeats=repeats, size=size, fewest=fewest)
        along = self.along
        heights = {f"height_{k + 1}": f"amplitude at {knot:g} times that" for k, knot in enumerate(KNOTS)}
        self._heights = tuple(
            Parameter(name, "1", 1.0, about, OWN, 0.0)
            for name, about in (heights if self.by else {"height": "amplitude"}).items()
        )
        self.parameters = (
            constant("size", size, POSITIVE, "what a height of 1 adds at the site, in its SI unit"),
            *self._magnitude,
            *self._heights,
            Parameter(
                "repeats",
                "1",
                repeats,
                f"periods by the SI unit of {along}",
                OWN,
                repeats,
                (fewest, 1e9),
                logarithmic=True,
            ),
            Parameter(
                "phase", "1", 1.0, "where the signal is 0, rad; over time the recordings' mean", OWN, 0.0
            ),
        )
        self.strength = dict.fromkeys((q.name for q in self._heights), LEAST)
        self.usual = (self.of_height(1.0),)
        over = f"a wave over {along.replace('_', ' ')}"
        changing = f", higher or lower with the magnitude of {self.by.replace('_', ' ')}" if self.by else ""
        self.law = f"{over}{changing}"
        often = "of {repeats} Hz" if along == TIME else "with {repeats} periods in its SI unit"
        self.says = f"{over} {often}{changing}{self.describes}"

    def sized(self, repeats: float, size: float) -> Self:
        """The same with other numbers."""
        signal = f"{self.along}{TIMES}{self.by}" if self.by else self.along
        return self.over(signal, repeats=repeats, size=size)

    def of_height(self, height: float) -> dict[str, float]:
        """Its heights, by own name, for this amplitude; proportional to the signal on which it depends."""
        shares = KNOTS if self.by else (1.0,)
        return {q.name: height * share for q, share in zip(self._heights, shares, strict=True)}

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The signal plus the wave."""
        own = {q.name: sheet.param(q) for q in self.parameters}
        a, b = ca.cos(own["phase"]), ca.sin(own["phase"])
        if self.along == TIME:
            sine, cosine = (sheet.state(name, "1", 0.3, spread=SPREAD) for name in ("sine", "cosine"))
            for standing in (sine, cosine):
                sheet.rate(standing, 0.0)
            a, b = a + sine, b + cosine
            signal = sheet.clock()
        else:
            signal = followed(self.along, near, sheet)
        turns = 2 * math.pi * own["repeats"] * signal
        return nominal + own["size"] * self._height(own, near, sheet) * (
            a * ca.sin(turns) + b * ca.cos(turns)
        )

    def _height(self, own: Mapping[str, Any], near: Mapping[str, Any], sheet: Sheet) -> Any:
        heights = [own[q.name] for q in self._heights]
        if not self.by:
            return heights[0]
        at = ca.fmin(ca.fabs(followed(self.by, near, sheet)) / own["magnitude"], KNOTS[-1])
        step = KNOTS[1] - KNOTS[0]
        return sum(
            h * ca.fmax(1 - ca.fabs(at - knot) / step, 0) for h, knot in zip(heights, KNOTS, strict=True)
        )
