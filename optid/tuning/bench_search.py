"""The search with a simulation with friction: each run takes milliseconds, and its result is partly random.

Where a sticking axis comes to rest is practically random, so the best of many candidates on few runs is mostly the
luckiest one. Candidates that fill the region are simulated in one run of each size; those that continue are chosen by
the mean over their neighbours (kernel regression: Nadaraya 1964, Watson 1964), which averages out chance, the last of
them in all runs. From the best regions an evolution strategy continues, each generation on another run; its result is a
mean of many candidates. Of the best result all gains are lowered together while they cost more by at most one standard
error of the difference: the simplest of the candidates that the runs cannot tell apart (Breiman et al., Classification
and Regression Trees, 1984, section 3.4.3), here the one with the least feedback, as no model shows all that feedback
meets.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from optid.core.model import Array
from optid.pid.pid_step import KD, KP
from optid.tuning.evolution_strategy import evolution_strategy
from optid.tuning.guarded_bench import GuardedBench
from optid.tuning.scenarios import Episode
from optid.tuning.search import PLACES, SIGNED, Evolved, GainBounds
from optid.tuning.task import Task
from optid.tuning.ultimate import Ultimate, ultimate

# Gains of the first stage in terms of the ultimate ones: kp Ku, ki Ku/Tu, kd Ku Tu, filter Tu; later ones may leave it.
# Good gains lie along a line of kd over kp: where both are free, the ratio is drawn instead, in Tu.
REGION = {"kp": (0.04, 8.0), "ki": (0.0, 0.05), "kd": (0.0, 4.0), "derivative_filter": (0.004, 0.08)}
DERIVATIVE_TIMES = (0.05, 1.0)
WITHOUT = 0.5  # share of the points without integral action
TOGETHER = 12  # candidates between two checks of the time limit
DRAWN = 20  # candidates drawn for each one needed, to find those that keep the margins


SECOND, THIRD = 80, 12  # the best candidates of run 1 that also go on run 2, and on all
REGIONS, APART = 2, 0.1  # regions that are continued, and their distance in the cube
# Candidates on run 1; generations in each region, and around the best result on two runs each. With a rig's model and a
# guard a longer search pays; on a simplified axis alone it finds more of what the simulation has and the rig has not.
USUAL, LONG = (400, 24, 16), (600, 36, 24)
SPREAD, LAST_SPREAD = 0.06, 0.03  # sd of its first generation
NEAR = 0.04  # sd of the kernel, in the cube
LOWER, LOWERED = 0.84, 14  # factor on all gains from one candidate to the next; how many at most: to a tenth
HOPELESS = 30.0  # times the best cost: larger costs are clipped to it

Said = Callable[[float, str], None]


@dataclass
class Effort:
    """Callbacks of a search.

    Attributes:
        said: called with the share done and the best cost so far.
        over: called before each evaluation; true ends the search with the best so far.
    """

    said: Said = lambda share, words: None
    over: Callable[[], bool] = lambda: False


def search_on_bench(
    task: Task, within: GainBounds, seeds: Array, rng: np.random.Generator, effort: Effort
) -> list[Evolved]:
    """Results of the search, the best first.

    Args:
        task: with a bench that alone judges performance.
        within: the box.
        seeds: points (k, free) to begin with.
        rng: source of everything random.
        effort: time and progress.
    """
    runs, used = sorted({one.run for one in _episodes(task) if one.run > 0}) or [0], 0

    def cost(points: Array, *numbers: int) -> Array:
        nonlocal used
        used += len(points)
        return _judged(task, within, points, [runs[k % len(runs)] for k in numbers], effort)

    count, generations, last_ones = LONG if isinstance(task.bench, GuardedBench) else USUAL
    points = np.vstack([seeds, _spread_out(task, within, count, rng)])
    seen = EvaluatedCandidates(points, cost(points, 0), np.ones(len(points)))
    best = seen.best(points, SECOND)
    seen = seen.and_also(best, cost(best, 1), 1)
    best = seen.best(best, THIRD)
    effort.said(0.25, "")
    tried = _on_all_runs(task, within, list(best))
    answers = []
    for number, start in enumerate(_distinct([end.point for end in tried])):
        effort.said(0.35 + 0.2 * number, "")
        answers.append(evolution_strategy(lambda p, g: cost(p, 1 + g), start, SPREAD, generations, rng))
    ends = sorted([*_on_all_runs(task, within, answers), tried[0]], key=lambda end: end.fitness)
    effort.said(0.85, "")
    last = evolution_strategy(
        lambda p, g: cost(p, 2 * g, 2 * g + 1), ends[0].point, LAST_SPREAD, last_ones, rng
    )
    first, *others = sorted([*_on_all_runs(task, within, [last]), *ends], key=lambda end: end.fitness)
    if not effort.over():
        first = _least_feedback(task, within, first, runs)
    return [replace(first, evaluations=used), *others]


def _least_feedback(task: Task, within: GainBounds, best: Evolved, runs: Sequence[int]) -> Evolved:
    """All free gains lowered together while that is dearer than the best by at most its standard error over the runs.

    If that holds without integral action too, then without it (Breiman et al., Classification and Regression Trees,
    1984, section 3.4.3).
    """

    def cost_of_each_run(point: Array) -> Array:
        return np.array([_task_of_runs(task, [k]).fitness(within.gains(point))[0] for k in runs])

    def one_standard_error_above(each: Array) -> float:
        return float(each.mean() + each.std() / math.sqrt(len(runs)))

    bar = one_standard_error_above(cost_of_each_run(best.point))
    feedback, gains = [PLACES[name] for name in SIGNED if name in within.free], within.gains(best.point)
    chosen = best.point
    for _ in range(LOWERED):
        gains[..., feedback] *= LOWER
        lower = within.points(gains).reshape(best.point.shape)
        each = cost_of_each_run(lower)
        if each.mean() > bar:
            break
        chosen, bar = lower, min(bar, one_standard_error_above(each))
    if "ki" in within.free:
        still = np.where(np.array(within.free) == "ki", 0.0, chosen)
        chosen = still if cost_of_each_run(still).mean() <= bar else chosen
    return _on_all_runs(task, within, [chosen])[0]


def _on_all_runs(task: Task, within: GainBounds, points: list[Array]) -> list[Evolved]:
    """On all runs, the best first."""
    costs = task.fitness(within.gains(np.array(points)))
    ends = [Evolved(point, float(cost), 0) for point, cost in zip(points, costs, strict=True)]
    return sorted(ends, key=lambda end: end.fitness)


def _distinct(points: Sequence[Array]) -> list[Array]:
    """Those, the best first, that are at a distance from all before."""
    found: list[Array] = []
    for point in points:
        if len(found) < REGIONS and all(float(np.abs(point - one).max()) > APART for one in found):
            found.append(point)
    return found


@dataclass(frozen=True, eq=False)
class EvaluatedCandidates:
    """Costs of candidates so far: points (n, free), costs (n,), and the number of runs of each size (n,)."""

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
        """The points with the lowest mean logarithmic cost of their neighbours, the best first."""
        lowest = float(self.costs.min())
        logs = np.log(np.minimum(self.costs, HOPELESS * lowest) / lowest) if lowest > 0.0 else self.costs
        squares = ((points[:, None, :] - self.points[None, :, :]) ** 2).sum(axis=2)
        weights = self.runs * np.exp(-0.5 * squares / NEAR**2)
        return points[np.argsort(weights @ logs / weights.sum(axis=1), kind="stable")[:count]]


def runs_of(task: Task, runs: Sequence[int]) -> list[int]:
    """Indices of the episodes of some runs, with those that belong to all; of all runs if there are none."""
    every = _episodes(task)
    chosen = [e for e, one in enumerate(every) if one.run < 0 or one.run in runs]
    steps = any(every[e].run >= 0 for e in chosen)
    return chosen if steps and runs else list(range(len(every)))


def _episodes(task: Task) -> tuple[Episode, ...]:
    return task.episodes if task.bench is None else task.bench.episodes


def few_episodes(task: Task) -> list[int]:
    """Indices of one episode of each size, with noise where there are any."""
    return sorted(runs_of(task, (1,)), key=lambda e: _episodes(task)[e].size)


def _judged(task: Task, within: GainBounds, points: Array, runs: Sequence[int], effort: Effort) -> Array:
    """Costs on some runs; infinite for those not reached before the time limit."""
    part = _task_of_runs(task, runs)
    values = np.full(len(points), np.inf)
    for first in range(0, len(points), TOGETHER):
        if first and effort.over():
            break
        several = slice(first, first + TOGETHER)
        values[several] = part.fitness(within.gains(points[several]))
    return values


def _task_of_runs(task: Task, runs: Sequence[int]) -> Task:
    return replace(task, bench=task.bench.only(runs_of(task, runs)) if task.bench else None)


def _spread_out(task: Task, within: GainBounds, count: int, rng: np.random.Generator) -> Array:
    """Points spread over the region, some without integral action, that keep the margins if enough can be found."""
    low, high = _region(within, ultimate(task.loops[0]))
    points = low + (high - low) * rng.random((DRAWN * count, low.size))
    if {"kp", "kd"} <= set(within.free) and not within.cascade:
        gains, times = within.gains(points), np.log(DERIVATIVE_TIMES)
        drawn = np.exp(rng.uniform(times[0], times[1], len(points))) * ultimate(task.loops[0]).period
        gains[:, KD] = gains[:, KP] * drawn
        points = within.points(gains)
    if "ki" in within.free:
        points[rng.random(len(points)) < WITHOUT, within.free.index("ki")] = 0.0
    kept = points[task.missed(within.gains(points)) <= 0.0]
    return kept[:count] if len(kept) else points[:count]


def _region(within: GainBounds, scale: Ultimate) -> tuple[Array, Array]:
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
