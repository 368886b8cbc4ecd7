"""The whole job of `optid tune` as one function with one frozen result."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from optid.errors import SolveError
from optid.pid.controller import Controller, Gains, Settings
from optid.tuning.baselines import Baseline, nelder_mead, rules
from optid.tuning.bench_search import Effort, runs_of
from optid.tuning.gradient import Gradient
from optid.tuning.local_search import polish
from optid.tuning.loop import ClosedLoop
from optid.tuning.margins import Margins, margins
from optid.tuning.optimise import Options, Search, as_gains, optimise
from optid.tuning.response_metrics import Response, response
from optid.tuning.search import GainBounds
from optid.tuning.sticking_axis import StickingAxis
from optid.tuning.systems import closed_loop, controller_system, open_loop
from optid.tuning.task import Task
from optid.tuning.ultimate import Ultimate, ultimate

if TYPE_CHECKING:
    import control

THIN = 2.0  # maximum sensitivity; Astrom and Hagglund (2006, section 4.6) recommend 1.2 to 2.0
UNSTABLE = (
    "The linear loop on the identified model is unstable (infinite maximum sensitivity): only friction and "
    "limits stabilise the simulated one. For gains that also stabilise the identified model: --ms 2."
)
SAME = 5e-2  # relative: searches that end this near to the best cost have found the same minimum
Bench = Callable[[Gains, Settings], tuple[Response, ...]]


@dataclass(frozen=True, eq=False)
class Scored:
    """Gains with their scores.

    Attributes:
        name: "tuned" or a baseline's.
        gains: None where the rule does not apply.
        note: on their origin.
        cost: the minimised cost of these gains; infinite where the loop diverges.
        margins: of the linear loop on the identified model.
        responses: on the identified model (with dry friction where it is an axis), one per episode.
        bench: on the physical model, where one was given.
    """

    name: str
    gains: Gains | None
    note: str
    cost: float
    margins: Margins | None
    responses: tuple[Response, ...] = ()
    bench: tuple[Response, ...] = ()

    @property
    def stable(self) -> bool:
        """Whether the linear loop is stable."""
        return self.margins is not None and self.margins.stable

    def total(self, measure: str, bench: bool = False) -> float:
        """Weighted sum of a measure ("itae") over the episodes; infinite without responses."""
        runs = self.bench if bench else self.responses
        return sum(r.episode.weight * r.measures[measure] for r in runs) if runs else math.inf


@dataclass(frozen=True)
class Certificate:
    """The best point of an exhaustive grid, compared with the result.

    Attributes:
        points: of the grid.
        best: smallest cost on it.
        ratio: cost found over that; at most 1 if the search is better than the grid.
        agreeing, starts: searches that ended within 5 % of the best cost, of how many.
        evaluations: of the cost, in the searches.
    """

    points: int
    best: float
    ratio: float
    agreeing: int
    starts: int
    evaluations: int


@dataclass(frozen=True, eq=False)
class Tuning:
    """The tuned gains, with the evidence for them.

    Attributes:
        gains: found.
        settings: of the controller they are for.
        task: of the tuning.
        found: the gains as scored; `baselines` likewise, for the same loop.
        unaware: gains that a tuning without limits chooses, scored with them; None where there are none.
        aware: for comparison: gains tuned with the limits on the same models.
        certificate: of the search.
        scale: ultimate gain and period.
        within: the search region.
        remarks: for the user, as sentences.
    """

    gains: Gains
    settings: Settings
    task: Task
    found: Scored
    baselines: tuple[Scored, ...]
    unaware: Scored | None
    aware: Scored
    certificate: Certificate
    scale: Ultimate
    within: GainBounds
    remarks: tuple[str, ...]

    @property
    def on_bench(self) -> bool:
        """Whether the rig's physical model judged."""
        return self.task.bench_alone and not isinstance(self.task.bench, StickingAxis)

    @property
    def controller(self) -> Controller:
        """A running controller with these gains."""
        return Controller(self.gains, self.settings)

    @property
    def open_loop(self) -> control.TransferFunction:
        """Controller, notch and identified model in a row, without limits; its margins are those of `found`."""
        return open_loop(self.task.loops[0], self.gains)

    @property
    def controller_system(self) -> control.StateSpace:
        """The controller without limits and notch, from set-point and measurement to command, for python-control."""
        return controller_system(self.gains, self.task.plant.sample_time)

    @property
    def closed_loop(self) -> control.StateSpace:
        """From set-point to output, both degrees of freedom, without limits."""
        return closed_loop(self.task.loops[0], self.gains)


def tune(
    task: Task,
    rng: np.random.Generator,
    options: Options | None = None,
    bench: Bench | None = None,
    present: Gains | None = None,
) -> Tuning:
    """Find gains, compare them with others, and certify.

    Args:
        task: the loop.
        rng: source of everything random.
        options: of the search.
        bench: runs gains on a physical model, one response an episode; if given, all gains are also tested there.
        present: gains in use, as a baseline.

    Raises:
        SolveError: no gains meet the requirements, or none stabilise the model.
    """
    options, scale = options or Options(), ultimate(task.loops[0])
    bench = bench or (None if isinstance(task.bench, StickingAxis) else task.bench)
    search = optimise(task, options, rng, scale)
    gains, within = search.gains, search.within
    others = _others(task, scale, within, gains, options.effort)
    if present is not None:
        others.insert(0, Baseline("present", present, "the gains in use today"))
    unaware = None if task.bench_alone else _unaware(task, options, rng, scale)
    rivals = [one.gains for one in (*others, unaware) if one is not None and one.gains is not None]
    gains = _outdone(task, within, gains, rivals)
    aware = Baseline("tuned", gains, "this tuning")
    if unaware is not None and task.bench is not None:
        swift = replace(task, bench=None)
        alone = _outdone(swift, within, optimise(swift, options, rng, scale).gains, rivals)
        aware = Baseline("identified_model_alone", alone, "tuned for the identified model alone")
    found = score(task, Baseline("tuned", gains, "this tuning"), bench)
    return Tuning(
        gains,
        task.settings,
        task,
        found,
        tuple(score(task, one, bench) for one in others),
        None if unaware is None else score(task, unaware, bench),
        score(task, aware, bench),
        _certificate(task, gains, search),
        scale,
        within,
        _remarks(task, found),
    )


def _others(task: Task, scale: Ultimate, within: GainBounds, gains: Gains, effort: Effort) -> list[Baseline]:
    """The baselines for this loop, with the same derivative filter.

    The simplex search uses the linear model where a slow physical one judges.
    """
    size = max((episode.size for episode in task.episodes), default=0.0) or 1.0
    most = min(abs(task.settings.low), abs(task.settings.high))
    most = most if 0.0 < most < math.inf else task.command_size
    found = rules(task.plant, scale, size, most, gains.derivative_filter)
    start = next(other.gains for other in found if other.name == "ziegler_nichols_ultimate")
    assert start is not None
    if effort.over():
        return found
    swift = task
    if task.bench_alone:
        few = tuple(task.episodes[e] for e in runs_of(replace(task, bench=None), (0, 1)))
        swift = replace(task, episodes=few, bench=None, bench_alone=False, hunting=math.inf)
    simplex = nelder_mead(lambda points: swift.fitness(within.gains(points)), within, start)
    return [*found, Baseline("nelder_mead", simplex, "the same cost, from Ziegler and Nichols' gains")]


def _outdone(task: Task, within: GainBounds, gains: Gains, rivals: list[Gains]) -> Gains:
    """If a baseline's gains, clipped to the box, have a lower cost than the result, the search continues from there."""
    if not rivals:
        return gains
    points = within.points(np.array([rival.vector for rival in rivals]))
    found = float(task.fitness(gains.vector)[0])
    costs = task.fitness(within.gains(points), np.full(len(points), found))
    best = int(np.argmin(costs))
    if not costs[best] < found:
        return gains
    if task.bench_alone:
        return as_gains(within.gains(points[best])[0])
    gradient = None if task.criterion.own or task.bench or within.cascade else Gradient(task, within.free)
    return as_gains(within.gains(polish(task, within, points[best], gradient))[0])


def _unaware(task: Task, options: Options, rng: np.random.Generator, scale: Ultimate) -> Baseline | None:
    """The gains of a tuning without limits; None where there are no limits, or no such gains exist."""
    limits = task.settings
    if math.isinf(limits.low) and math.isinf(limits.high) and math.isinf(limits.rate):
        return None
    free = replace(limits, low=-math.inf, high=math.inf, rate=math.inf, deadband_low=0.0, deadband_high=0.0)
    try:
        gains = optimise(replace(task, settings=free, bench=None), options, rng, scale).gains
    except SolveError:
        return None
    return Baseline("without_limits", gains, "tuned without limits")


def _remarks(task: Task, found: Scored) -> tuple[str, ...]:
    """Remarks on the model and on the tuned loop."""
    alone = task.bench_alone and bool(found.bench)
    judged = found.bench if alone else found.responses
    slow = [r for r in judged if r.episode.rise[-1] != 0.0 and math.isinf(r.settled) and r.episode.run <= 0]
    swings = max((run.hunting for run in judged), default=0.0)
    hunts = [f"It hunts: {swings:.3g} peak to peak at rest; no gains without hunting were found."]
    Ms = found.margins.maximum_sensitivity if found.margins else math.inf
    thin = [f"Thin margins: maximum sensitivity {Ms:.3g}; up to 2 is usual."] if Ms > THIN else []
    if not found.stable:
        thin = [UNSTABLE]
    lost = [run for run in found.bench if not run.bounded]
    return (
        *task.plant.remarks,
        *thin,
        *(hunts if swings > task.hunting else []),
        *(
            f"{run.episode.name}: not settled within the horizon; a longer one is set by --horizon."
            for run in slow
        ),
        *(f"{run.episode.name}: on the physical model the loop is unstable." for run in lost),
    )


def _certificate(task: Task, gains: Gains, search: Search) -> Certificate:
    """The comparison of the result with the grid."""
    best = float(task.fitness(gains.vector)[0])
    agreeing = sum(end.fitness <= best * (1.0 + SAME) for end in search.ends)
    used = sum(end.evaluations for end in search.ends)
    if not search.grid.size:
        return Certificate(0, math.nan, math.nan, agreeing, len(search.ends), used)
    lowest = float(search.grid.min())
    return Certificate(search.grid.size, lowest, best / lowest, agreeing, len(search.ends), used)


def compared(tuning: Tuning) -> list[Scored]:
    """Further rows for comparison with the tuned gains."""
    aware = [] if tuning.aware.gains == tuning.gains else [tuning.aware]
    return aware if tuning.unaware is None else [*aware, tuning.unaware]


def score(task: Task, one: Baseline, bench: Bench | None = None) -> Scored:
    """Run gains on the model, and on the bench where there is one."""
    if one.gains is None:
        return Scored(one.name, None, one.note, math.inf, None)
    vector, T = one.gains.vector, task.settings.sample_time
    loop: ClosedLoop = task.closed_loop
    if isinstance(task.bench, StickingAxis):
        runs = task.bench(one.gains, task.settings)
    else:
        runs = tuple(response(e, *loop.trace(vector, 0, n), T) for n, e in enumerate(task.episodes))
    cost = float(task.fitness(vector)[0]) if task.bench_alone else float(task.together(loop.costs(vector))[0])
    tried = bench(one.gains, task.settings) if bench else ()
    return Scored(one.name, one.gains, one.note, cost, margins(task.loops[0], vector), runs, tried)
