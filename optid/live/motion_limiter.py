"""Limits of speed, travel and stroke: the directions in which a command may still drive.

A command above the safe one drives towards larger positions, by convention. Where the axis is too fast, too far from
where it began, or about to reach the end of its stroke, a command in the same direction is replaced by the safe one.
"""

from __future__ import annotations

import math
from collections import deque

from optid.live.settings import Settings

BASE = 0.02  # s over which the speed is measured, two samples at least


class MotionLimiter:
    """Monitors the position and limits commands.

    Args:
        settings: limits of speed, travel and stroke, and how far ahead the stroke's end is looked for.
    """

    def __init__(self, settings: Settings) -> None:
        self._limits, self._ahead = settings.limits, settings.ahead
        self._seen: deque[tuple[float, float]] = deque(maxlen=1 + max(2, round(BASE * settings.rate)))
        self._start = math.nan

    def held(self, time: float, position: float, wish: float) -> float:
        """The command, or the safe command in its place.

        Args:
            time: of the sample, s.
            position: measured, SI; NaN is missing.
            wish: command, SI.
        """
        if not math.isfinite(position):
            self._seen.clear()
            return wish
        if self._start != self._start:
            self._start = position
        self._seen.append((time, position))
        way = wish - self._limits.safe
        return self._limits.safe if any(way * side > 0.0 for side in self._closed(position)) else wish

    def _closed(self, position: float) -> list[float]:
        """The blocked directions, as +1 and -1."""
        limits, speed, far = self._limits, self._speed(), position - self._start
        closed = []
        if abs(speed) >= limits.speed:
            closed.append(math.copysign(1.0, speed))
        if abs(far) >= limits.travel:
            closed.append(math.copysign(1.0, far))
        if self._ahead:
            there = position + speed * self._ahead
            closed += [
                side
                for side, end in ((-1.0, limits.stroke[0]), (1.0, limits.stroke[1]))
                if (there - end) * side >= 0.0
            ]
        return closed

    def _speed(self) -> float:
        (before, start), (now, end) = self._seen[0], self._seen[-1]
        return (end - start) / (now - before) if now > before else 0.0
