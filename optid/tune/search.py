"""The global search: differential evolution over gains, several times over, in a box that the plant suggests."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from optid.core.model import Array
from optid.errors import InputError, nearest
from optid.pid.controller import Gains
from optid.pid.law import DERIVATIVE_FILTER, DERIVATIVE_WEIGHT, KD, KI, KP, SETPOINT_WEIGHT
from optid.tune.ultimate import Ultimate

Fitness = Callable[[Array], Array]

PLACES = {
    "kp": KP, "ki": KI, "kd": KD, "derivative_filter": DERIVATIVE_FILTER, "setpoint_weight": SETPOINT_WEIGHT,
    "derivative_weight": DERIVATIVE_WEIGHT,
}  # fmt: skip
POPULATION, GENERATIONS = 28, 60
AGREED = 1e-3  # relative spread of a population's costs below which it has gathered
CROSSOVER = 0.9
FACTOR = (0.45, 0.95)  # of differences, drawn anew for each trial


@dataclass(frozen=True, eq=False)
class Box:
    """Where gains are looked for; the search moves points of the unit cube.

    Attributes:
        free: names of the gains that move.
        low, high: their bounds, shape (free,), without the sign; where `low` is positive the scale is logarithmic.
        fixed: all gains, of which the free ones are replaced.
        sign: of the proportional, integral and derivative gain.
    """

    free: tuple[str, ...]
    low: Array
    high: Array
    fixed: Array
    sign: float

    def gains(self, points: Array) -> Array:
        """Of points (n, free) in the unit cube: shape (n, GAINS)."""
        points = np.atleast_2d(points)
        out = np.tile(self.fixed, (len(points), 1))
        for j, name in enumerate(self.free):
            low, high = self.low[j], self.high[j]
            value = low * (high / low) ** points[:, j] if low > 0.0 else low + (high - low) * points[:, j]
            out[:, PLACES[name]] = value * (self.sign if name in ("kp", "ki", "kd") else 1.0)
        return out

    def points(self, gains: Array) -> Array:
        """The reverse for gains (n, GAINS), moved into the cube."""
        gains = np.atleast_2d(gains)
        out = np.empty((len(gains), len(self.free)))
        for j, name in enumerate(self.free):
            low, high = self.low[j], self.high[j]
            value = gains[:, PLACES[name]] * (self.sign if name in ("kp", "ki", "kd") else 1.0)
            if low > 0.0:
                out[:, j] = np.log(np.maximum(value, low) / low) / math.log(high / low)
            else:
                out[:, j] = (value - low) / (high - low)
        return np.clip(out, 0.0, 1.0)

    def slopes(self, points: Array) -> Array:
        """d gains / d point of one point (free,): the free gains' own, shape (free,)."""
        gains = self.gains(points)[0]
        value = np.array([gains[PLACES[name]] for name in self.free])
        log = np.where(self.low > 0.0, self.low, 1.0)
        return np.where(self.low > 0.0, value * np.log(self.high / log), self.high - self.low)


def box(free: tuple[str, ...], start: Gains, scale: Ultimate) -> Box:
    """Bounds from the plant's ultimate gain and period: generous ones, a factor of thousands.

    Args:
        free: names of the gains that move.
        start: values of those that do not.
        scale: of the plant.

    Raises:
        InputError: an unknown name, one named twice, or none.
    """
    for name in free:
        if name not in PLACES:
            raise InputError(f'"{name}"', field="free", hint=nearest(name, PLACES))
    if not free or len(set(free)) != len(free):
        raise InputError(f"{', '.join(free) or 'none'}", field="free", expected="each gain to move, once")
    Ku, Tu = abs(scale.gain), scale.period
    ranges = {
        "kp": (1e-3 * Ku, 20.0 * Ku), "ki": (1e-4 * Ku / Tu, 30.0 * Ku / Tu), "kd": (1e-4 * Ku * Tu, 10.0 * Ku * Tu),
        "derivative_filter": (1e-3 * Tu, 0.5 * Tu), "setpoint_weight": (0.0, 1.5), "derivative_weight": (0.0, 1.0),
    }  # fmt: skip
    low, high = (np.array([ranges[name][side] for name in free]) for side in (0, 1))
    return Box(free, low, high, start.vector, math.copysign(1.0, scale.gain))


@dataclass(frozen=True, eq=False)
class Evolved:
    """Where one population ended: its best point (free,), that one's fitness, and evaluations used."""

    point: Array
    fitness: float
    evaluations: int


def evolve(
    fitness: Fitness, dimensions: int, rng: np.random.Generator, seeds: Array | None = None
) -> Evolved:
    """Differential evolution in the unit cube (Storn and Price 1997), half-way towards the best one so far.

    Args:
        fitness: of points (n, dimensions), shape (n,); infinity and huge numbers are as good as anything bad.
        dimensions: of the cube.
        rng: source of everything random.
        seeds: points (k, dimensions) to begin with, beside the random ones.
    """
    size = POPULATION + 8 * max(dimensions - 3, 0)
    # Latin hypercube: every slice of every axis is visited once.
    points = (
        rng.permuted(np.tile(np.arange(size), (dimensions, 1)), axis=1).T + rng.random((size, dimensions))
    ) / size
    if seeds is not None:
        points[: len(seeds)] = seeds
    value, used, rows = fitness(points), size, np.arange(size)
    for _ in range(GENERATIONS * max(dimensions, 3) // 3):
        best = points[np.argmin(value)]
        one, two, three = (
            rows + 1 + rng.permuted(np.tile(np.arange(size - 1), (size, 1)), axis=1)[:, :3].T
        ) % size
        factor = rng.uniform(*FACTOR, (size, 1))
        pull = rng.random((size, 1))
        trial = points[one] + pull * (best - points[one]) * factor + factor * (points[two] - points[three])
        stay = rng.random((size, dimensions)) > CROSSOVER
        stay[rows, rng.integers(dimensions, size=size)] = False
        trial = np.where(stay, points, trial)
        trial = np.where(
            (trial < 0.0) | (trial > 1.0), rng.random((size, dimensions)) * 0.5 + 0.5 * points, trial
        )
        new = fitness(trial)
        used += size
        won = new <= value
        points[won], value[won] = trial[won], new[won]
        finite = value[np.isfinite(value)]
        if finite.size == size and np.ptp(finite) <= AGREED * abs(float(finite.min())):
            break
    top = int(np.argmin(value))
    return Evolved(points[top].copy(), float(value[top]), used)
