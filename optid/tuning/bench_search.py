"""The search where a simulation with friction judges: each run takes milliseconds, and chance decides much of it.

Where an axis that sticks comes to rest is as good as random, so the best of many candidates on few runs is mostly the
luckiest one. Candidates are raced: many meet one run of each size, samples around the best ones meet other runs, and
the last few meet all runs (a cross-entropy search: Rubinstein and Kroese, The Cross-Entropy Method, 2004, with the
racing of Maron and Moore, Artificial Intelligence Review 11, 1997). A stage never reuses the runs of the one before,
and which candidates go on is decided by the mean over their neighbours, with all that was seen of them (kernel
regression: Nadaraya 1964, Watson 1964): luck is not shared among neighbours, merit is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from optid.core.model import Array
from optid.tuning.demand import Episode
from optid.tuning.search import Box, Evolved
from optid.tuning.task import Task
from optid.tuning.ultimate import Ultimate, ultimate

# Gains of the first stage in terms of the ultimate ones: kp Ku, ki Ku/Tu, kd Ku Tu, filter Tu; later ones may leave it.
REGION = {"kp": (0.04, 8.0), "ki": (0.0, 0.5), "kd": (0.0, 4.0), "derivative_filter": (0.004, 0.08)}
WITHOUT = 0.5  # share of the points that begin without integral action
DRAWN = 20  # candidates drawn for each one wanted, to find such as keep the margins


@dataclass(frozen=True)
class Stage:
    """Samples around the best so far, each on some runs.

    Attributes:
        count: of candidates; 0 takes the best so far as they are.
        parents: how many of the best so far.
        spread: sd of the samples around a parent, in the cube.
        runs: numbers of the runs that judge.
    """

    count: int
    parents: int
    spread: float
    runs: tuple[int, ...]


FIRST = 500  # candidates on run 1
STAGES = (
    Stage(300, 30, 0.035, (2,)),
    Stage(200, 25, 0.025, (3,)),
    Stage(120, 20, 0.02, (4, 5)),
    Stage(60, 15, 0.015, (6, 7)),
    Stage(0, 16, 0.0, tuple(range(8, 16))),
    Stage(0, 6, 0.0, ()),
)
NEAR = 0.025  # sd of the kernel, in the cube
HOPELESS = 30.0  # times the best cost: what costs more counts as much

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


def search_on_bench(
    task: Task, within: Box, seeds: Array, rng: np.random.Generator, effort: Effort
) -> list[Evolved]:
    """Ends of the search, the best first.

    Args:
        task: with a bench that judges alone.
        within: the box.
        seeds: points (k, free) to begin with.
        rng: source of everything random.
        effort: time and progress.
    """
    points = np.vstack([seeds, _spread_out(task, within, FIRST, rng)])
    values, used = _judged(task, within, points, (1,), effort), len(points)
    seen = EvaluatedCandidates(points, values, np.ones(len(points)))
    for number, stage in enumerate(STAGES):
        if effort.over():
            break
        effort.said(0.3 + 0.7 * number / len(STAGES), "")
        best = seen.best(points, stage.parents)
        points = np.vstack([best, _around(best, stage, rng)]) if stage.count else best
        values = _judged(task, within, points, stage.runs, effort)
        seen = seen.and_also(points, values, len(stage.runs))
        used += len(points)
    order = np.argsort(values)
    ends = [
        Evolved(points[i], float(task.fitness(within.gains(points[i][None]))[0]), used) for i in order[:2]
    ]
    return sorted(ends, key=lambda end: end.fitness)


@dataclass(frozen=True, eq=False)
class EvaluatedCandidates:
    """What candidates cost so far: points (n, free), costs (n,), and in how many runs of each size (n,)."""

    points: Array
    costs: Array
    runs: Array

    def and_also(self, points: Array, costs: Array, runs: int) -> EvaluatedCandidates:
        """With more of them."""
        return EvaluatedCandidates(
            np.vstack([self.points, points]),
            np.r_[self.costs, costs],
            np.r_[self.runs, np.full(len(points), float(max(runs, 1)))],
        )

    def best(self, points: Array, count: int) -> Array:
        """Of some points those that are best by the mean of their neighbours' logarithmic costs, the best first."""
        lowest = float(self.costs.min())
        logs = np.log(np.minimum(self.costs, HOPELESS * lowest) / lowest) if lowest > 0.0 else self.costs
        squares = ((points[:, None, :] - self.points[None, :, :]) ** 2).sum(axis=2)
        weights = self.runs * np.exp(-0.5 * squares / NEAR**2)
        return points[np.argsort(weights @ logs / weights.sum(axis=1), kind="stable")[:count]]


def runs_of(task: Task, runs: Sequence[int]) -> list[int]:
    """Numbers of the episodes of some runs, with those that belong to all; of all runs where there are none such."""
    every = _episodes(task)
    chosen = [e for e, one in enumerate(every) if one.run < 0 or one.run in runs]
    steps = any(every[e].run >= 0 for e in chosen)
    return chosen if steps and runs else list(range(len(every)))


def _episodes(task: Task) -> tuple[Episode, ...]:
    return task.episodes if task.bench is None else task.bench.episodes


def few_episodes(task: Task) -> list[int]:
    """Numbers of one episode of each size, with noise where there are such."""
    return sorted(runs_of(task, (1,)), key=lambda e: _episodes(task)[e].size)


def _judged(task: Task, within: Box, points: Array, runs: Sequence[int], effort: Effort) -> Array:
    """Costs on some runs; infinite for what there was no time for."""
    part = replace(task, bench=task.bench.only(runs_of(task, runs)) if task.bench else None)
    values = np.full(len(points), np.inf)
    for i, point in enumerate(points):
        if i and effort.over():
            break
        values[i] = part.fitness(within.gains(point[None]))[0]
    return values


def _around(best: Array, stage: Stage, rng: np.random.Generator) -> Array:
    parents = best[rng.integers(0, len(best), stage.count)]
    return np.clip(parents + stage.spread * rng.standard_normal(parents.shape), 0.0, 1.0)


def _spread_out(task: Task, within: Box, count: int, rng: np.random.Generator) -> Array:
    """Points over the region, a share of them without integral action, that keep the margins if enough can be found."""
    low, high = _region(within, ultimate(task.loops[0]))
    points = low + (high - low) * rng.random((DRAWN * count, low.size))
    if "ki" in within.free:
        points[rng.random(len(points)) < WITHOUT, within.free.index("ki")] = 0.0
    kept = points[task.missed(within.gains(points)) <= 0.0]
    return kept[:count] if len(kept) else points[:count]


def _region(within: Box, scale: Ultimate) -> tuple[Array, Array]:
    """Lowest and highest coordinates of the first stage."""
    Ku, Tu = abs(scale.gain), scale.period
    unit = {"kp": within.sign * Ku, "ki": within.sign * Ku / Tu, "kd": within.sign * Ku * Tu}
    unit["derivative_filter"] = Tu
    corners = np.tile(within.fixed, (2, 1))
    for name, place in zip(within.free, within.places, strict=True):
        if name in unit:
            corners[:, place] = unit[name] * np.array(REGION[name])
    low, high = within.points(corners)
    weights = [i for i, name in enumerate(within.free) if name not in unit]
    low[weights], high[weights] = 0.0, 1.0
    return low, high
