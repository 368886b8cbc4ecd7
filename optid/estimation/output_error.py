"""Output error: where a fit without process noise ends, on simulations of whole segments.

Windows whose ends must meet leave Gauss-Newton a valley so narrow that it stops far from the lowest simulation error;
a segment simulated in one has no ends to meet. Where a model misses by many standard deviations, a free start would
trade an error at the beginning for the model's errors later on, and what such a fit says is not what a free run
shows: a start that is measured is known to the sensor's noise, which then counts for more than what the model says.
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass, replace

import numpy as np

from optid.core.model import Array
from optid.core.simulation import carry
from optid.errors import SolveError
from optid.estimation.initial_trajectory import measured_states
from optid.estimation.noise_continuation import HARD, LEVELS, SETTLED, Pace, Solution, marginal
from optid.estimation.problem import Integers, Problem
from optid.estimation.result import Outcome
from optid.estimation.smoother import PASSING, Objective, Point, Terms, Watch, descend, evaluate, priced

LONG = 400  # iterations: where friction breaks away at other times the cost is rough, and the way down long
ROUNDS = 3  # of the start's weight, which follows from the misfit
LOOSE = LEVELS[:4]  # process noise of the windows from which a second start comes
EXPLAINED = 2.0  # error over noise up to which none is needed


@dataclass(frozen=True, eq=False)
class Simulated:
    """Where a search ended.

    Attributes:
        objective: over windows, with the starts' weights.
        at: the point, with the simulated states at the nodes.
        error_over_noise: by how much the residuals exceed the sensors' noise, at least 1.
        settled: whether the search did.
    """

    objective: Objective
    at: Point
    error_over_noise: float
    settled: bool


def fit_by_simulation(o: Objective, at: Point, terms: Terms | None, pace: Pace) -> Solution:
    """The lowest simulation error: from the start, and where that leaves more than noise from the windows' end too.

    Raises:
        SolveError: the model cannot be simulated from either.
    """
    best = _simulated(o, at, pace)
    if best is None or best.error_over_noise > EXPLAINED or not best.settled:
        for step, level in enumerate(LOOSE):
            watch = pace.watch(f"process noise {level:g}", (step + 1) / (len(LOOSE) + 2))
            with contextlib.suppress(SolveError):
                at, terms, _ = descend(
                    o, at, level * o.model.scales, precision=PASSING, terms=terms, watch=watch
                )
        other = None if pace.late() and best is not None else _simulated(o, at, pace)
        found = [one for one in (best, other) if one is not None]
        if not found:
            raise SolveError("the simulation diverges wherever it starts: allow process noise")
        best = min(found, key=lambda one: one.error_over_noise)
    q = HARD * o.model.scales
    o, at, terms = best.objective, best.at, joined(best, q)
    pace.keep(at)
    short = Outcome.TIME_LIMIT if pace.late() else Outcome.NOT_CONVERGED
    return Solution(o, at, terms, q, marginal(o, at, terms, q), Outcome.CONVERGED if best.settled else short)


def _simulated(o: Objective, at: Point, pace: Pace) -> Simulated | None:
    """The nearest lowest simulation error; ``None`` where it cannot be simulated."""
    with contextlib.suppress(SolveError, np.linalg.LinAlgError):
        return output_error(o, at, HARD * o.model.scales, SETTLED, pace.watch("simulating", 0.0))
    return None


def output_error(o: Objective, at: Point, q: Array, precision: float, watch: Watch) -> Simulated:
    """Minimise the simulation error of whole segments from a point.

    Args:
        o: over windows.
        at: where to start.
        q: process noise that stands for none, (states,), SI.
        precision: relative decrease of the cost that ends it.
        watch: called after every iteration; says whether to stop.

    Raises:
        SolveError: the model cannot be simulated from there.
    """
    heads = np.flatnonzero(o.heads)
    whole, here = replace(o, problem=_in_one(o.problem, heads)), Point(at.X[heads], at.p)
    terms = evaluate(whole, here, q)
    ratio, settled = _error_over_noise(terms), False
    for left in reversed(range(ROUNDS)):
        whole = _measured_start(whole, ratio)
        enough = precision if left == 0 else PASSING
        here, terms, settled = descend(
            whole, here, q, precision=enough, iterations=LONG, terms=terms, watch=watch
        )
        ratio = _error_over_noise(terms)
        if not settled:
            break
    known = np.full_like(at.X, np.nan)
    known[heads] = here.X
    nodes = carry(o.model, here.p, here.X[0], o.problem, known, o.tolerance).nodes[0]
    segment = np.cumsum(o.heads).astype(int) - 1
    known_start = replace(o, start=whole.start[segment], spread=whole.spread[segment])
    return Simulated(known_start, Point(np.asarray(nodes), here.p), ratio, settled)


def joined(found: Simulated, q: Array) -> Terms:
    """The linearisation over windows there; their ends meet but for the integrator's error, which says nothing."""
    terms = evaluate(found.objective, found.at, q)
    return priced(found.objective, found.at, replace(terms, defect=np.zeros_like(terms.defect)), q)


def _in_one(b: Problem, heads: Integers) -> Problem:
    """Every segment one window."""
    every = np.ones(len(heads), dtype=np.bool_)
    return replace(
        b,
        begins=b.begins[heads],
        counts=np.add.reduceat(b.counts, heads),
        closed=every,
        linked=~every,
        recording=b.recording[heads],
    )


def _error_over_noise(t: Terms) -> float:
    """By how much the residuals exceed the sensors' noise, at least 1."""
    loss, samples = t.misfit.sum(axis=0)
    return max(1.0, math.sqrt(float(loss / max(samples, 1.0))))


def _measured_start(o: Objective, ratio: float) -> Objective:
    """The measured states known at each start as their sensors show them, in units of what the model misses."""
    b, windows = o.problem, len(o.problem.begins)
    start = np.broadcast_to(o.start, (windows, len(o.model.states))).copy()
    spread = np.broadcast_to(o.spread, start.shape).copy()
    for state, output in measured_states(o.model)[0].items():
        y, weight = b.measured[b.begins, output], o.weight[b.begins, output]
        known = np.isfinite(y) & (weight > 0)
        start[known, state] = y[known]
        spread[known, state] = 1.0 / (weight[known] * ratio)
    return replace(o, start=start, spread=spread)
