"""The global search: repeated differential evolution over gains, in a box derived from the plant."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from optid.core.model import Array
from optid.errors import InputError, nearest
from optid.pid.controller import Gains
from optid.pid.pid_step import DERIVATIVE_FILTER, DERIVATIVE_WEIGHT, KD, KI, KP, SETPOINT_WEIGHT
from optid.tuning.structures import cascaded
from optid.tuning.ultimate import Ultimate

Fitness = Callable[[Array, Array | None], Array]

PLACES = {
    "kp": KP,
    "ki": KI,
    "kd": KD,
    "derivative_filter": DERIVATIVE_FILTER,
    "setpoint_weight": SETPOINT_WEIGHT,
    "derivative_weight": DERIVATIVE_WEIGHT,
}
SIGNED = ("kp", "ki", "kd")
LINEAR, LOGARITHMIC = 1e-3, 7.0  # bends of a scale; the latter is logarithmic over about three decades
POPULATION, MORE, GENERATIONS = 28, 8, 60  # the second one for each gain beyond three
AGREED = 1e-3  # relative spread of a population's costs below which it has converged
CROSSOVER = 0.9
FACTOR = (0.45, 0.95)  # of differences, drawn anew for each trial


@dataclass(frozen=True, eq=False)
class GainBounds:
    """The search region of gains; the search uses points of the unit cube.

    A gain is `high` sinh(bend x) / sinh(bend): linear near 0, which is allowed, and logarithmic beyond.

    Attributes:
        free: names of the gains to optimise.
        high: their largest values without the sign, shape (free,); the smallest are 0.
        bend: shape (free,); a small one is a linear scale.
        fixed: all gains, of which the free ones are replaced.
        sign: of the proportional, integral and derivative gain.
        cascade: the gains are those of P position over PI velocity (`optid.tuning.structures`): the optimised
            proportional gain is the position loop's, and gain and set-point weight of the controller follow from all
            three.
    """

    free: tuple[str, ...]
    high: Array
    bend: Array
    fixed: Array
    sign: float
    cascade: bool = False

    @property
    def places(self) -> list[int]:
        """Of the free gains among all."""
        return [PLACES[name] for name in self.free]

    @property
    def signed(self) -> Array:
        """Largest values with their signs, shape (free,)."""
        return np.asarray(self.high * np.array([self.sign if name in SIGNED else 1.0 for name in self.free]))

    def gains(self, points: Array) -> Array:
        """Of points (n, free) in the unit cube: shape (n, GAINS)."""
        points = np.atleast_2d(points)
        out = np.tile(self.fixed, (len(points), 1))
        out[:, self.places] = self.signed * np.sinh(self.bend * points) / np.sinh(self.bend)
        return cascaded(out) if self.cascade else out

    def points(self, gains: Array) -> Array:
        """The reverse for gains (n, GAINS), moved into the cube."""
        gains = np.array(np.atleast_2d(gains), dtype=float)
        if self.cascade:
            gains[:, KP] *= gains[:, SETPOINT_WEIGHT]
        share = gains[:, self.places] / self.signed
        return np.asarray(np.clip(np.arcsinh(share * np.sinh(self.bend)) / self.bend, 0.0, 1.0))

    def slopes(self, point: Array) -> Array:
        """d gain / d coordinate at one point (free,), of each free gain: shape (free,)."""
        return np.asarray(self.signed * self.bend * np.cosh(self.bend * point) / np.sinh(self.bend))


def box(free: tuple[str, ...], fixed: Gains, scale: Ultimate) -> GainBounds:
    """Bounds from the plant's ultimate gain and period, far beyond the gains of any rule.

    Args:
        free: names of the gains to optimise.
        fixed: values of the others.
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
    high = {
        "kp": 20.0 * Ku,
        "ki": 30.0 * Ku / Tu,
        "kd": 10.0 * Ku * Tu,
        "derivative_filter": 0.5 * Tu,
        "setpoint_weight": 1.5,
        "derivative_weight": 1.0,
    }
    bend = np.array([LINEAR if name.endswith("weight") else LOGARITHMIC for name in free])
    return GainBounds(
        free, np.array([high[name] for name in free]), bend, fixed.vector, math.copysign(1.0, scale.gain)
    )


@dataclass(frozen=True, eq=False)
class Evolved:
    """The result of one population: its best point (free,), its fitness, and the evaluations used."""

    point: Array
    fitness: float
    evaluations: int


def slices(within: GainBounds, count: int) -> list[tuple[Array, Array]]:
    """Parts of the unit cube, half overlapping, so that several searches do not all end in one local minimum.

    They divide the axis along which several local minima were observed: that of the integral gain, where free.

    Returns:
        Lowest and highest coordinates (free,) of each part.
    """
    dimensions = len(within.free)
    axis = within.free.index("ki") if "ki" in within.free else 0
    parts = []
    for i in range(count):
        low, high = np.zeros(dimensions), np.ones(dimensions)
        if count > 1:
            low[axis], high[axis] = i / (count + 1), (i + 2) / (count + 1)
        parts.append((low, high))
    return parts


def evolve(
    fitness: Fitness,
    part: tuple[Array, Array],
    rng: np.random.Generator,
    seeds: Array | None = None,
    generations: int = GENERATIONS,
    population: int = POPULATION,
    over: Callable[[], bool] = lambda: False,
) -> Evolved:
    """Differential evolution (Storn and Price 1997), each trial is moved towards the best one so far.

    Args:
        fitness: of points (n, free), shape (n,); its second argument is the cost that each point must undercut.
        part: lowest and highest coordinates.
        rng: source of everything random.
        seeds: initial points (k, free), in addition to random ones.
        generations: at most, for three gains; more for more.
        population: points, for three gains; more for more.
        over: called before each generation; true ends the search.
    """
    low, high = part
    dimensions = low.size
    size = population + MORE * max(dimensions - 3, 0)
    # Latin hypercube: every slice of every axis has one point.
    share = (
        rng.permuted(np.tile(np.arange(size), (dimensions, 1)), axis=1).T + rng.random((size, dimensions))
    ) / size
    points = low + (high - low) * share
    if seeds is not None:
        points[: len(seeds)] = seeds
    value, used, rows = fitness(points, None), size, np.arange(size)
    for _ in range(generations * max(dimensions, 3) // 3):
        if over():
            break
        best = points[np.argmin(value)]
        others = rng.permuted(np.tile(np.arange(size - 1), (size, 1)), axis=1)[:, :3].T
        one, two, three = (rows + 1 + others) % size
        factor, pull = rng.uniform(*FACTOR, (size, 1)), rng.random((size, 1))
        trial = points[one] + factor * (pull * (best - points[one]) + points[two] - points[three])
        stay = rng.random((size, dimensions)) > CROSSOVER
        stay[rows, rng.integers(dimensions, size=size)] = False
        trial = np.where(stay, points, trial)
        # Beyond a bound: a random point between the bound and the parent.
        inwards = points + rng.random((size, dimensions)) * (np.where(trial < low, low, high) - points)
        trial = np.where((trial < low) | (trial > high), inwards, trial)
        new = fitness(trial, value)
        used += size
        won = new <= value
        points[won], value[won] = trial[won], new[won]
        if np.isfinite(value).all() and np.ptp(value) <= AGREED * abs(float(value.min())):
            break
    top = int(np.argmin(value))
    return Evolved(points[top].copy(), float(value[top]), used)
