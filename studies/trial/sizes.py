"""Drawing a number of a stated size out of a range."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from studies.trial.case import SIZES


@dataclass(frozen=True)
class Draw:
    """The randomness of one effect, and its size.

    Attributes:
        size: small, medium or large.
        rng: what is drawn from.
        share: of the range (in logarithms), in place of a drawn one; below 0 and above 1 is beyond its ends.
        flipped: every sign comes out the other way.
    """

    size: str
    rng: np.random.Generator
    share: float | None = None
    flipped: bool = False

    def sized(self, least: float, most: float) -> float:
        """From the lower, middle or upper third (in logarithms) of the range; `most` is the strongest."""
        third = SIZES.index(self.size)
        drawn = (third + self.rng.uniform(0.15, 0.85)) / 3  # in any case: what is drawn next hangs on it
        return float(least * (most / least) ** (drawn if self.share is None else self.share))

    def between(self, low: float, high: float) -> float:
        """Anywhere in the range, evenly in logarithms."""
        return float(math.exp(self.rng.uniform(math.log(low), math.log(high))))

    def evenly(self, low: float, high: float) -> float:
        """Anywhere in the range."""
        return float(self.rng.uniform(low, high))

    def sign(self) -> float:
        """+1 or -1."""
        return float(self.rng.choice([-1.0, 1.0])) * (-1.0 if self.flipped else 1.0)

    def one_of(self, *choices: float) -> float:
        """Any of these."""
        return float(self.rng.choice(choices))
