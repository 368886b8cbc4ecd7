"""Monitor of the mismatch between rig and physical model, in fixed memory."""

from __future__ import annotations

import math
from dataclasses import dataclass

MEMORY = 20.0  # s over which errors and motion are averaged
# s for which the model must fit badly before that is reported, and well before it is withdrawn.
PATIENCE = 10.0
BAD_FIT = 95.0  # percent of the 0.5 s windowed prediction, below which rig and model disagree
NOISES = 3.0  # an error of fewer sd of the sensor's noise is not a mismatch, for any fit


@dataclass(frozen=True)
class Verdict:
    """`fit_percent` over the last seconds (NaN before there was motion), and whether it has been low for long."""

    fit_percent: float
    disagree: bool


class MismatchMonitor:
    """Exponential averages of the squared error and of the motion's variance.

    Args:
        span: sampling time, s.
    """

    def __init__(self, span: float) -> None:
        self._share, self._span = span / MEMORY, span
        self._error = self._mean = self._square = self._weight = 0.0
        self._contrary, self._disagree = 0.0, False

    def add(self, measured: float, windowed: float, noise: float) -> None:
        """Take one sample; NaN is skipped.

        Args:
            measured: position, m.
            windowed: the model's, m.
            noise: sd of the sensor, m.
        """
        error = measured - windowed
        if error - error != 0.0:
            return
        keep, new = 1.0 - self._share, self._share
        self._weight = keep * self._weight + new
        self._error = keep * self._error + new * error * error
        self._mean = keep * self._mean + new * measured
        self._square = keep * self._square + new * measured * measured
        rms = math.sqrt(self._error / self._weight)
        bad = rms > NOISES * noise and self.fit_percent < BAD_FIT
        self._contrary = self._contrary + self._span if bad != self._disagree else 0.0
        if self._contrary > PATIENCE:
            self._disagree, self._contrary = bad, 0.0

    @property
    def fit_percent(self) -> float:
        """100 (1 - rms error / sd of the position) over the last seconds."""
        if not self._weight:
            return math.nan
        mean = self._mean / self._weight
        variance = self._square / self._weight - mean * mean
        if variance <= 0.0:
            return math.nan
        return 100.0 * (1.0 - math.sqrt(self._error / self._weight / variance))

    @property
    def verdict(self) -> Verdict:
        """The present verdict."""
        return Verdict(self.fit_percent, self._disagree)
