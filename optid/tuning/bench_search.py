"""The search where a physical model judges: a run takes milliseconds, so few candidates meet few episodes first.

A population on a handful of episodes, then simplex searches from its best distinct ends on all of them; candidates
that are beaten already are not run to the end.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from optid.core.model import Array
from optid.tuning.search import Box, Evolved, evolve
from optid.tuning.task import Task
from optid.tuning.ultimate import Ultimate, ultimate

# Gains of the first stage in terms of the ultimate ones: kp Ku, ki Ku/Tu, kd Ku Tu; later stages may go beyond.
REGION = {"kp": (0.04, 3.0), "ki": (0.0, 0.5), "kd": (0.0, 0.7)}
POPULATION, GENERATIONS = 20, 18  # of the first stage
WITHOUT = 0.5  # share of its points that begin without integral action
SCREENED, APART = 12, 0.02  # ends tried on all episodes, and how far apart in the cube they are at least
ENDS = 2  # of them, that a simplex search follows
FIRST, LAST = 40, 40  # evaluations of each simplex search, and of the one from the best end
SIDE, CLOSE = 0.03, 0.01  # their first simplices' sides
HOPELESS = 1.5  # times the best cost: not run to the end

Said = Callable[[float, str], None]


@dataclass
class Effort:
    """What a search is told from outside, and tells.

    Attributes:
        said: told the share done and the best cost so far.
        over: asked before each evaluation; true ends the search with the best so far.
    """

    said: Said = lambda share, words: None
    over: Callable[[], bool] = lambda: False


class Enough(Exception):  # no error: the time is up
    """Ends a search that goes on by itself."""


def search_on_bench(
    task: Task, within: Box, seeds: Array, rng: np.random.Generator, effort: Effort
) -> list[Evolved]:
    """Ends of all searches, the best first; never worse than the best seed.

    Args:
        task: with a bench that judges alone.
        within: the box.
        seeds: points (k, free) to begin with.
        rng: source of everything random.
        effort: time and progress.
    """
    best = _Best(task, within, effort)
    few = replace(task, bench=task.bench.only(few_episodes(task)) if task.bench else None)
    first = _Best(few, within, effort)
    try:
        low, high = _region(within, ultimate(task.plant))
        count = min(len(seeds), POPULATION // 2)
        begin = _begun(within, low, high, seeds[:count], rng)
        evolve(first.population, (low, high), rng, begin, GENERATIONS, len(begin))
        effort.said(0.45, "")
        for point in _distinct(first.seen, SCREENED):
            best.single(point)
        for number, point in enumerate(_distinct(best.seen, ENDS)):
            effort.said(0.5 + 0.15 * number, "")
            _simplex(best.single, point, SIDE, FIRST)
        effort.said(0.8, "")
        _simplex(best.single, best.top()[1], CLOSE, LAST)
    except Enough:
        if not best.seen:
            best.population((first.top()[1] if first.seen else seeds[0])[None], None, always=True)
    return best.ends()


def _region(within: Box, scale: Ultimate) -> tuple[Array, Array]:
    """Lowest and highest coordinates of the first stage."""
    Ku, Tu = abs(scale.gain), scale.period
    unit = {"kp": Ku, "ki": Ku / Tu, "kd": Ku * Tu}
    corners = np.tile(within.fixed, (2, 1))
    for name, place in zip(within.free, within.places, strict=True):
        if name in unit:
            corners[:, place] = within.sign * unit[name] * np.array(REGION[name])
    low, high = within.points(corners)
    weights = [i for i, name in enumerate(within.free) if name not in unit]
    low[weights], high[weights] = 0.0, 1.0
    return low, high


def _begun(within: Box, low: Array, high: Array, seeds: Array, rng: np.random.Generator) -> Array:
    """The first population: seeds, and points over the region of which a share has no integral action."""
    count = POPULATION + 6 * max(len(within.free) - 3, 0)
    share = (
        rng.permuted(np.tile(np.arange(count), (low.size, 1)), axis=1).T + rng.random((count, low.size))
    ) / count
    points = low + (high - low) * share
    if "ki" in within.free:
        points[rng.random(count) < WITHOUT, within.free.index("ki")] = 0.0
    points[: len(seeds)] = np.clip(seeds, low, high)
    return points


def few_episodes(task: Task) -> list[int]:
    """Numbers of one episode of each size, with noise where there are such."""
    noisy = [e for e, one in enumerate(task.episodes) if one.noise.any()] or list(range(len(task.episodes)))
    sizes: dict[float, int] = {}
    for e in noisy:
        sizes.setdefault(float(task.episodes[e].reference[-1]), e)
    return sorted(sizes.values(), key=lambda e: abs(float(task.episodes[e].reference[-1])))


class _Best:
    """A task's fitness that remembers what it has seen."""

    def __init__(self, task: Task, within: Box, effort: Effort) -> None:
        self.task, self.within, self.effort = task, within, effort
        self.seen: list[tuple[float, Array]] = []

    def population(self, points: Array, bar: Array | None, always: bool = False) -> Array:
        if self.effort.over() and not always:
            raise Enough
        values = self.task.fitness(self.within.gains(points), bar)
        beaten = np.zeros(len(values), dtype=bool) if bar is None else values > bar
        self.seen += [
            (float(value), point.copy())
            for value, point, lost in zip(values, points, beaten, strict=True)
            if not lost
        ]
        return values

    def single(self, point: Array) -> float:
        inside = np.clip(point, 0.0, 1.0)
        bar = np.array([HOPELESS * self.top()[0]]) if self.seen else None
        return float(self.population(inside[None], bar)[0])

    def top(self) -> tuple[float, Array]:
        return min(self.seen, key=lambda one: one[0])

    def ends(self) -> list[Evolved]:
        used = len(self.seen)
        points = _distinct(self.seen, ENDS)
        value = {point.tobytes(): cost for cost, point in self.seen}
        return [Evolved(point, value[point.tobytes()], used) for point in points]


def _distinct(seen: list[tuple[float, Array]], count: int) -> list[Array]:
    found: list[Array] = []
    for _, point in sorted(seen, key=lambda one: one[0]):
        if all(np.abs(point - other).max() >= APART for other in found):
            found.append(point)
        if len(found) == count:
            break
    return found


def _simplex(fitness: Callable[[Array], float], point: Array, side: float, most: int) -> None:
    from scipy.optimize import minimize

    start = np.vstack([point, point + side * np.where(point < 0.5, 1.0, -1.0) * np.eye(len(point))])
    minimize(
        fitness,
        point,
        method="Nelder-Mead",
        options={"maxfev": most, "initial_simplex": start, "adaptive": True},
    )
