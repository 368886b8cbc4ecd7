"""Whether PID gains stabilise a discrete model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from optid.armax.model import Armax
from optid.core.model import Array


@dataclass(frozen=True)
class Gains:
    """Of u = kp w + ki integral(w) + kd dw/dt, w = r - y, as pid.json has them.

    Attributes:
        kp, ki, kd: ki per second, kd times seconds.
        derivative_filter: time constant of the derivative's lag, seconds.
    """

    kp: float
    ki: float = 0.0
    kd: float = 0.0
    derivative_filter: float = 0.0

    def polynomials(self, sample_time: float) -> tuple[Array, Array]:
        """Numerator and denominator in z by backward differences: 1/s becomes T z/(z - 1)."""
        T, lag = sample_time, self.derivative_filter
        integrator, derivative = np.array([1.0, -1.0]), np.array([lag + T, -lag])
        if self.ki == 0.0:
            integrator = np.array([1.0])
        if self.kd == 0.0:
            derivative = np.array([1.0])
        denominator = np.polymul(integrator, derivative)
        parts = [self.kp * denominator]
        if self.ki != 0.0:
            parts.append(np.polymul([self.ki * T, 0.0], derivative))
        if self.kd != 0.0:
            parts.append(np.polymul([self.kd, -self.kd], integrator))
        numerator = np.zeros(denominator.size)
        for part in parts:
            numerator[numerator.size - part.size :] += part
        return numerator, denominator


@dataclass(frozen=True)
class Loop:
    """The closed loop of a model with given gains.

    Attributes:
        gains: as given.
        stable: all closed-loop poles lie inside the unit circle.
        poles: of the closed loop.
        first_sample: loop gain of the first sample, the product of the first coefficients.
        first_sample_kp: the same with kp alone.
        largest_factor: largest common factor on all gains; 0 where no scaling stabilises.
    """

    gains: Gains
    stable: bool
    poles: tuple[complex, ...]
    first_sample: float
    first_sample_kp: float
    largest_factor: float


def close_loop(model: Armax, gains: Gains, input: int = 0) -> Loop:
    """Close the loop of one input and compute its poles."""
    numerator, denominator = model.powers_of_z(input)
    top, bottom = gains.polynomials(model.sample_time)

    def poles(factor: float) -> Array:
        return np.asarray(
            np.roots(np.polyadd(np.polymul(denominator, bottom), factor * np.polymul(numerator, top)))
        )

    def stable(factor: float) -> bool:
        return bool(np.all(np.abs(poles(factor)) < 1.0))

    ends = poles(1.0)
    first = float(np.trim_zeros(numerator, "f")[0]) if np.any(numerator) else 0.0
    return Loop(
        gains,
        stable(1.0),
        tuple(complex(p) for p in ends),
        first * float(top[0] / bottom[0]),
        first * gains.kp,
        _largest(stable),
    )


def _largest(stable: object) -> float:
    """The smallest factor at which stability is lost; 0 if the loop is never stable."""
    assert callable(stable)
    factors = np.geomspace(1e-9, 1e4, 400)
    low = 0.0
    for factor in factors:
        if stable(factor):
            low = float(factor)
        elif low > 0.0:
            high = float(factor)
            for _ in range(40):
                middle = (low * high) ** 0.5
                low, high = (middle, high) if stable(middle) else (low, middle)
            return low
    return low
