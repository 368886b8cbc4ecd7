"""The pace of a session: the machine's own clock, or as fast as it goes."""

from __future__ import annotations

import time
from typing import Protocol

SPIN = (
    150e-6  # s before a sample in which the clock is watched instead of slept: sleeping overshoots by so much
)


class Clock(Protocol):
    """Tells when samples are due; time counts from sample 0, in seconds."""

    def begin(self) -> None:
        """Sample 0 is now."""

    def wait(self, sample: int) -> float:
        """Return at the sample's time, or at once when that has passed; the time it is then."""

    def now(self) -> float:
        """The time."""

    def left(self, sample: int, share: float) -> float | None:
        """s until so much of the sample's period is over; ``None`` where nothing is ever late."""


class RealClock:
    """The machine's clock, by sleeping and then watching it."""

    def __init__(self, span: float) -> None:
        self._span, self._zero = span, time.perf_counter()

    def begin(self) -> None:
        """Sample 0 is one period ahead."""
        self._zero = time.perf_counter() + self._span

    def wait(self, sample: int) -> float:
        """Return at the sample's time, or at once when that has passed."""
        due = self._zero + sample * self._span
        ahead = due - time.perf_counter()
        if ahead > SPIN:
            time.sleep(ahead - SPIN)
        while (now := time.perf_counter()) < due:
            pass
        return now - self._zero

    def now(self) -> float:
        """Time since sample 0, s."""
        return time.perf_counter() - self._zero

    def left(self, sample: int, share: float) -> float | None:
        """s until so much of the sample's period is over, never below zero."""
        return max(self._zero + (sample + share) * self._span - time.perf_counter(), 0.0)


class FastClock:
    """Every sample is due when the one before is done."""

    def __init__(self, span: float) -> None:
        self._span, self._sample = span, 0

    def begin(self) -> None:
        """Sample 0 is now."""
        self._sample = 0

    def wait(self, sample: int) -> float:
        """The sample's time."""
        self._sample = sample
        return sample * self._span

    def now(self) -> float:
        """The time of the sample in work."""
        return self._sample * self._span

    def left(self, sample: int, share: float) -> float | None:
        """Nothing is ever late."""
        return None
