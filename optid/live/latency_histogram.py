"""Histogram of durations in logarithmic classes, of a fixed size for any length of a session."""

from __future__ import annotations

import math

LOWEST = 1e-7  # s
PER_DECADE = 40  # classes: a percentile is accurate to 6 %
DECADES = 8


class LatencyHistogram:
    """Number, mean, largest and percentiles of durations in seconds."""

    def __init__(self) -> None:
        self._counts = [0] * (PER_DECADE * DECADES)
        self.number, self._sum, self._largest = 0, 0.0, 0.0

    def add(self, seconds: float) -> None:
        """Count one."""
        place = int(PER_DECADE * math.log10(seconds / LOWEST)) if seconds > LOWEST else 0
        self._counts[place if place < len(self._counts) else -1] += 1
        self.number += 1
        self._sum += seconds
        if seconds > self._largest:
            self._largest = seconds

    def percentile(self, percent: float) -> float:
        """The upper edge of its class, s; NaN before anything was counted."""
        if not self.number:
            return math.nan
        wanted, seen = percent / 100 * self.number, 0
        for place, count in enumerate(self._counts):
            seen += count
            if seen >= wanted and count:
                return float(min(LOWEST * 10 ** ((place + 1) / PER_DECADE), self._largest))
        return self._largest

    def summary(self) -> dict[str, float | int] | None:
        """Summary in microseconds, as in `live.json`; ``None`` before anything was counted."""
        if not self.number:
            return None
        rows = {
            "mean": self._sum / self.number,
            "p50": self.percentile(50),
            "p99": self.percentile(99),
            "p999": self.percentile(99.9),
            "max": self._largest,
        }
        return {
            "number": self.number,
            **{f"{name}_us": round(1e6 * value, 2) for name, value in rows.items()},
        }
