"""The integrals by which a response is judged."""

from __future__ import annotations

from enum import Enum

import numpy as np

from optid.core.model import Array


class Measure(Enum):
    """Integral over an episode of |error|^power, with or without the time since the last change of the reference."""

    ITAE = ("time times absolute error", True, 1)
    IAE = ("absolute error", False, 1)
    ITSE = ("time times squared error", True, 2)
    ISE = ("squared error", False, 2)

    @property
    def timed(self) -> bool:
        """Whether errors are weighted by time."""
        return bool(self.value[1])

    @property
    def power(self) -> int:
        """Of the error."""
        return int(self.value[2])

    def weights(self, clock: Array, sample_time: float) -> Array:
        """Of |error|^power at each sample, same shape."""
        return sample_time * clock if self.timed else np.full(clock.shape, sample_time)
