"""The clock of a session: real time, or as fast as possible."""

from __future__ import annotations

import time
from typing import Protocol

SPIN = 150e-6  # s before a sample of busy waiting instead of sleeping: sleeping overshoots by this much


class Clock(Protocol):
    """Tells when samples are due; time counts from sample 0, in seconds."""

    def begin(self) -> None:
        """Sample 0 is now."""

    def wait(self, sample: int) -> float:
        """Wait for the sample's time, or return at once when that has passed; returns the present time."""

    def now(self) -> float:
        """The time."""

    def left(self, sample: int, share: float) -> float | None:
        """s until this share of the sample's period is over; ``None`` if no sample can be late."""


class RealClock:
    """Real time, by sleeping and then busy waiting."""

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
        """s until this share of the sample's period is over, not negative."""
        return max(self._zero + (sample + share) * self._span - time.perf_counter(), 0.0)


class FastClock:
    """Every sample is due when the one before is finished."""

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
