"""The reaction curve: gain, lag and delay for the classical tuning rules, from the model's step response."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from optid.core.model import Array
from optid.tuning.plant import Plant
from optid.tuning.ultimate import Ultimate

SLOW = 0.3  # a pole whose time constant is more than three ultimate periods acts as an integrator
LONGEST = 400_000  # samples of a step response


@dataclass(frozen=True)
class Reaction:
    """K exp(-L s)/(T s + 1), or K exp(-L s)/s for a plant that integrates.

    Attributes:
        gain: K; output per command, per second too where it integrates.
        lag: T, s; infinite where it integrates.
        delay: L, s.
    """

    gain: float
    lag: float
    delay: float

    @property
    def integrating(self) -> bool:
        """Whether the output keeps moving at a constant command."""
        return bool(np.isinf(self.lag))

    @property
    def slope(self) -> float:
        """Of the output's rise after a step of 1, per second: K/T, or K where it integrates."""
        return self.gain if self.integrating else self.gain / self.lag


def reaction(plant: Plant, scale: Ultimate) -> Reaction | None:
    """None for a plant whose step response neither settles nor rises steadily: the rules do not apply to it.

    An integrator is divided out, and its delay is the mean time by which the speed lags (Astrom and Hagglund 2006,
    section 2.7); else T and L follow from when 28 % and 63 % of the way are passed (Smith 1972).
    """
    h, poles = plant.sample_time, plant.poles
    slow = [p for p in poles if abs(p - 1.0) * scale.period / h < SLOW]
    others = [p for p in poles if p not in slow]
    if len(slow) > 1 or any(abs(p) >= 1.0 for p in others):
        return None
    slowest = max((abs(p) for p in others), default=0.0)
    samples = min(LONGEST, 50 + int(12.0 / -np.log(slowest))) if slowest > 0.05 else 50
    if slow:
        rest = np.real(np.poly(others)) if others else np.array([1.0])
        speed = Plant(np.pad(rest[1:], (0, plant.a.size - rest.size + 1)), plant.b, h).simulate(
            np.ones(samples)
        )
        gain = float(speed[-1])
        # The integrator sums the speed sample by sample: half a sample of its sum is not a delay.
        delay = h * max(float(np.sum(1.0 - speed / gain)) - 0.5, 0.5)
        return Reaction(gain / h, np.inf, delay)
    response = plant.simulate(np.ones(samples))
    return _two_points(response / plant.static_gain, plant.static_gain, h)


def _two_points(share: Array, gain: float, sample_time: float) -> Reaction:
    early, late = (_passed(share, level) * sample_time for level in (0.283, 0.632))
    lag = max(1.5 * (late - early), 0.1 * sample_time)
    return Reaction(gain, lag, max(late - lag, 0.5 * sample_time))


def _passed(share: Array, level: float) -> float:
    """When a response first reaches a level, in samples, between two of them."""
    at = int(np.argmax(share >= level))
    if at == 0:
        return 0.0
    return at - 1 + float((level - share[at - 1]) / (share[at] - share[at - 1]))
