"""The search for gains: populations in slices of a box, the minima of a grid, and a local polish of both."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from optid.core.model import Array
from optid.errors import InputError, SolveError
from optid.pid.controller import Gains
from optid.pid.pid_step import GAINS, KI
from optid.tuning.bench_search import Effort, search_on_bench
from optid.tuning.gradient import Gradient
from optid.tuning.local_search import polish
from optid.tuning.search import GENERATIONS, Evolved, GainBounds, box, evolve, slices
from optid.tuning.task import REFUSED, Task
from optid.tuning.ultimate import Ultimate, ultimate

# Least derivative filter by default: samples, share of the ultimate period.
LAG_SAMPLES, LAG_SHARE = 1.0, 1 / 80
POINTS, SLOW_POINTS = 3000, 700  # largest number of grid points; the second with a physical model
WITH_BENCH = 80  # generations of a search in which a physical model runs
# Of the cube; populations around the best result, and the gain required of each.
AROUND, ROUNDS, WORTHWHILE = 0.06, 4, 5e-4
SWIFT = 25  # generations of the search on the linear model that only gives a start
# Bend of the scale of ki where friction is simulated: linear below 1e-3 Ku/Tu, which matters there.
FINE_INTEGRAL = 12.0
VALLEYS = 3  # minima of the grid that are polished


@dataclass(frozen=True)
class Options:
    """Options of the search.

    Attributes:
        free: gains to optimise; the others have the values of `fixed`.
        fixed: None for a derivative filter that suits the plant, and set-point weight 1.
        starts: populations, each from points of its own.
        grid: points on each axis of the certificate's grid; 0 for none.
        cascade: search for P position over PI velocity.
        effort: receives the progress, and ends the search at its time limit.
        polish: continue to the exact optimum; without it, searches end within a tenth of a per cent.
    """

    free: tuple[str, ...] = ("kp", "ki", "kd")
    fixed: Gains | None = None
    starts: int = 4
    grid: int = 14
    polish: bool = True
    cascade: bool = False
    effort: Effort = field(default_factory=Effort)

    def __post_init__(self) -> None:
        for name, least in (("starts", 1), ("grid", 0)):
            if getattr(self, name) < least:
                raise InputError(f"{getattr(self, name)}", field=name, expected=f"at least {least}")


@dataclass(frozen=True, eq=False)
class Search:
    """The result of a search.

    Attributes:
        gains: the best.
        ends: of every start, polished, and of the best valleys of the grid.
        within: the box.
        grid: costs on a grid over the box, any shape; empty for none.
    """

    gains: Gains
    ends: tuple[Evolved, ...]
    within: GainBounds
    grid: Array


def optimise(task: Task, options: Options, rng: np.random.Generator, scale: Ultimate | None = None) -> Search:
    """The search alone: populations in slices of the box and the valleys of a grid, all polished.

    Raises:
        SolveError: no gains in the box meet the requirements.
    """
    scale = scale or ultimate(task.loops[0])
    within = box(options.free, options.fixed or default_gains(task, scale), scale)
    within = replace(within, cascade=options.cascade)
    if task.bench is not None and task.bench_alone:
        return _on_bench(task, within, rng, options.effort)
    swift = replace(task, bench=None)
    over = options.effort.over
    ends = []
    for number, part in enumerate(slices(within, options.starts)):
        options.effort.said(0.7 * number / options.starts, "")
        ends.append(
            evolve(lambda points, bar: swift.fitness(within.gains(points), bar), part, rng, over=over)
        )
    costs, valleys = _screened(swift, within, min(options.grid, int(POINTS ** (1.0 / len(options.free)))))
    kept = [end for end in (*ends, *valleys) if end.fitness < REFUSED]
    if not kept:
        raise SolveError(_refusal(task, min(end.fitness for end in ends)))
    ends = kept
    if options.polish and not over():
        gradient = None if task.criterion.own or options.cascade else Gradient(swift, options.free)
        ends = [_polished(swift, within, end, gradient, over) for end in kept]
        ends += _closer(swift, within, min(ends, key=lambda end: end.fitness), rng, gradient, over)
    if task.bench is not None:
        seeds = np.array([end.point for end in ends])
        whole = slices(within, 1)[0]
        tried = [_evolved(task, within, whole, rng, begin, WITH_BENCH, over=over) for begin in (seeds, None)]
        ends = [_polished(task, within, min(tried, key=lambda end: end.fitness), None, over), *tried]
        ends += _closer(task, within, ends[0], rng, None, over, WITH_BENCH // 2)
        costs, _ = _screened(task, within, min(options.grid, int(SLOW_POINTS ** (1.0 / len(options.free)))))
    best = min(ends, key=lambda end: end.fitness)
    return Search(as_gains(within.gains(best.point)[0]), tuple(ends), within, costs)


def _on_bench(task: Task, within: GainBounds, rng: np.random.Generator, effort: Effort) -> Search:
    """The search with the physical model alone, started from gains that keep the margins on the linear one.

    Raises:
        SolveError: no gains in the box meet the requirements.
    """
    points = _keeping(task, within, rng)
    finer = replace(within, bend=np.where(np.array(within.free) == "ki", FINE_INTEGRAL, within.bend))
    points, within = finer.points(within.gains(points)), finer
    ends = search_on_bench(task, within, points, rng, effort)
    if ends[0].fitness >= REFUSED:
        raise SolveError(_refusal(task, ends[0].fitness))
    return Search(as_gains(within.gains(ends[0].point)[0]), tuple(ends), within, np.empty(0))


def _keeping(task: Task, within: GainBounds, rng: np.random.Generator) -> Array:
    """Points of low cost on the linear model that keep the margins, with and without integral action, best first."""
    without = replace(within, fixed=np.where(np.arange(GAINS) == KI, 0.0, within.fixed))
    quiet = [e for e in task.episodes if e.run <= 0] or list(task.episodes)
    swift = replace(task, bench=None, bench_alone=False, hunting=math.inf, episodes=tuple(quiet))
    ends = [_evolved(swift, within, slices(within, 1)[0], rng, None, SWIFT)]
    if "ki" in within.free:
        still = replace(without, free=tuple(n for n in within.free if n != "ki"))
        columns = [i for i, name in enumerate(within.free) if name != "ki"]
        still = replace(still, high=within.high[columns], bend=within.bend[columns])
        one = _evolved(swift, still, slices(still, 1)[0], rng, None, SWIFT)
        ends.insert(0, replace(one, point=within.points(still.gains(one.point))[0]))
    begin = np.array([end.point for end in ends])
    around = np.clip(begin[0] + 0.1 * rng.standard_normal((400, begin.shape[1])), 0.0, 1.0)
    if "ki" in within.free:
        around[:, within.free.index("ki")] *= rng.random(len(around)) ** 2
    kept = around[task.missed(within.gains(around)) <= 0.0]
    return np.vstack([begin, kept[: 2 * len(within.free)]])


def _closer(
    task: Task,
    within: GainBounds,
    best: Evolved,
    rng: np.random.Generator,
    gradient: Gradient | None,
    over: Callable[[], bool],
    generations: int = GENERATIONS,
) -> list[Evolved]:
    """Populations around the best result while they still improve: a polish stops early along a narrow ridge."""
    found: list[Evolved] = []
    for _ in range(ROUNDS):
        if over():
            break
        part = np.clip(best.point - AROUND, 0.0, 1.0), np.clip(best.point + AROUND, 0.0, 1.0)
        near = _evolved(task, within, part, rng, best.point[None], generations, over=over)
        end = _polished(task, within, near, gradient, over)
        gained = end.fitness < best.fitness * (1.0 - WORTHWHILE)
        found.append(end)
        if not gained:
            break
        best = end
    return found


def _screened(task: Task, within: GainBounds, aside: int) -> tuple[Array, list[Evolved]]:
    """Costs on a grid of `aside` points along each axis, and its lowest local minima."""
    dimensions = len(within.free)
    if aside < 2:
        return np.empty(0), []
    axes = np.meshgrid(*[np.linspace(0.0, 1.0, aside)] * dimensions, indexing="ij")
    points = np.stack([axis.ravel() for axis in axes], axis=1)
    costs = task.fitness(within.gains(points)).reshape((aside,) * dimensions)
    lowest = np.ones(costs.shape, dtype=bool)
    for axis in range(dimensions):
        rise = np.diff(costs, axis=axis)
        edge = [slice(None)] * dimensions
        edge[axis] = slice(0, aside - 1)
        lowest[tuple(edge)] &= rise >= 0.0
        edge[axis] = slice(1, aside)
        lowest[tuple(edge)] &= rise <= 0.0
    there = np.flatnonzero(lowest.ravel())
    there = there[np.argsort(costs.ravel()[there])][:VALLEYS]
    return costs, [Evolved(points[i], float(costs.ravel()[i]), 0) for i in there]


def _evolved(task: Task, within: GainBounds, *how: Any, **more: Any) -> Evolved:
    return evolve(lambda points, bar: task.fitness(within.gains(points), bar), *how, **more)


def _polished(
    task: Task, within: GainBounds, end: Evolved, gradient: Gradient | None, over: Callable[[], bool]
) -> Evolved:
    """The end of a local search from there, or the same where the time is over."""
    if over():
        return end
    point = polish(task, within, end.point, gradient)
    return replace(end, point=point, fitness=float(task.fitness(within.gains(point))[0]))


def as_gains(vector: Array) -> Gains:
    """Gains from a vector in the order of `optid.pid.pid_step`."""
    return Gains(*(float(value) for value in vector))


def default_gains(task: Task, scale: Ultimate) -> Gains:
    """Defaults of fixed gains: full set-point weight, derivative of the measurement, a filter that suits the plant."""
    lag = max(LAG_SAMPLES * task.settings.sample_time, LAG_SHARE * scale.period)
    return Gains(kp=scale.gain, derivative_filter=lag)


def _refusal(task: Task, fitness: float) -> str:
    if fitness / REFUSED - 1.0 >= 10.0:
        return (
            "no gains within a factor of thousands of the plant's scale stabilise this model: identify again, or "
            "with another order"
        )
    asked = [
        f"{name.replace('_', ' ')} {value:g}"
        for name, value in vars(task.required).items()
        if value is not None
    ]
    if asked and fitness > REFUSED:
        miss = 100 * (fitness / REFUSED - 1)
        return f"no gains keep {' and '.join(asked)}; the best ones miss by {miss:.2g} %: relax the margins"
    return "every stabilising loop diverges in simulation (NaN or infinite): the limits are too tight for this model"
