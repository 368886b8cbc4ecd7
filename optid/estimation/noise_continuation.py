"""The smoother's process noise: annealed from loose to tight; the level of highest likelihood is kept."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from optid.core.model import Array, Model
from optid.errors import SolveError
from optid.estimation.result import Outcome
from optid.estimation.smoother import (
    PASSING,
    PRECISE,
    Objective,
    Point,
    Terms,
    Watch,
    descend,
    settled_system,
)

PATIENCE = 2  # consecutive levels of lower likelihood that end it; a single one may not have converged
LOOSEST = 0.3  # process noise per node, as a share of each state's usual size, with which a fit begins
# Factor from one level to the next, and by which the states of one unit are then varied separately, up and down.
RUNG = 3.0
HARD = 1e-6  # the share that represents no process noise
TIGHT = 1e-5  # practically none, where the iteration still converges easily
# Relative decrease of the cost that ends a fit: about 0.001 in -2 log likelihood, as its roughness.
SETTLED = 1e-7
# The annealing schedule that all states follow together.
LEVELS = tuple(LOOSEST / RUNG**k for k in range(round(math.log(LOOSEST / TIGHT, RUNG))))


@dataclass(frozen=True, eq=False)
class Solution:
    """Where one start ended: on which objective, the point, its linearisation, process noise, and marginal score."""

    objective: Objective
    at: Point
    terms: Terms
    q: Array
    score: float
    outcome: Outcome


@dataclass(frozen=True)
class Pace:
    """Callbacks of a search: `watch` for the stage and the share done, the time limit, and the checkpoint."""

    watch: Callable[[str, float], Watch]
    late: Callable[[], bool]
    keep: Callable[[Point], None]


def anneal(o: Objective, at: Point, terms: Terms | None, asked: float | None, pace: Pace) -> Solution:
    """Anneal from loose to tight; keeps the level that the marginal likelihood prefers (or the level `asked`)."""
    levels: tuple[float, ...] = LEVELS
    if asked is not None:
        levels = (*(level for level in LEVELS if level > asked), asked)
    best: Solution | None = None
    worse_by = 0
    for step, level in enumerate(levels):
        watch = pace.watch(f"process noise {level:g}", step / (len(levels) + 1))
        try:
            found = _descended(o, at, terms, level * o.model.scales, watch)
        except SolveError:
            if asked is not None or (best is None and level == levels[-1]):
                raise
            if best is None:
                continue  # at this level the states do not determine a parameter; a tighter level may
            break  # the rest depends on rounding only: the looser level is kept
        at, terms = found.at, found.terms
        pace.keep(at)
        worse = best is not None and asked is None and found.score > best.score
        if best is None or not worse:
            best = found
        if pace.late():
            return best
        worse_by = worse_by + 1 if worse else 0
        if worse_by == PATIENCE:
            break  # a tighter level explains the data less well: the model is not better than this
    assert best is not None
    if asked is None:
        best = _by_unit(o, best, len(levels) / (len(levels) + 1), pace)
    return _settled(o, best, pace)


def _by_unit(o: Objective, best: Solution, share: float, pace: Pace) -> Solution:
    """The noise of each unit's states separately, step by step while the likelihood rises.

    An error of a law is in one equation; the same noise in all of them would weaken the others.
    """
    for unit, states in _units(o.model).items():
        first = best
        for factor in (1.0 / RUNG, RUNG):
            if best is not first:
                break  # the other direction was already visited
            while not pace.late():
                q = best.q.copy()
                q[states] *= factor
                levels = q[states] / o.model.scales[states]
                if levels.min() < TIGHT or levels.max() > LEVELS[0]:
                    break
                watch, found = pace.watch(f"process noise in {unit}", share), None
                with contextlib.suppress(SolveError, np.linalg.LinAlgError):
                    found = _descended(o, best.at, best.terms, q, watch)
                if found is None or found.score >= best.score:
                    break
                best = found
                pace.keep(best.at)
    return best


def _units(model: Model) -> dict[str, list[int]]:
    groups: dict[str, list[int]] = {}
    for i, state in enumerate(model.states):
        groups.setdefault(state.unit, []).append(i)
    return groups


def _descended(o: Objective, at: Point, terms: Terms | None, q: Array, watch: Watch) -> Solution:
    at, terms, _ = descend(o, at, q, precision=PASSING, terms=terms, watch=watch)
    return Solution(o, at, terms, q, marginal(o, at, terms, q), Outcome.TIME_LIMIT)


def _settled(o: Objective, best: Solution, pace: Pace) -> Solution:
    at, terms, settled = descend(
        o,
        best.at,
        best.q,
        precision=SETTLED,
        terms=best.terms,
        watch=pace.watch("settling", 1.0),
    )
    pace.keep(at)
    short = Outcome.TIME_LIMIT if pace.late() else Outcome.NOT_CONVERGED
    outcome = Outcome.CONVERGED if settled else short
    return Solution(o, at, terms, best.q, marginal(o, at, terms, best.q), outcome)


def go_on(o: Objective, found: Solution, asked: float | None, pace: Pace) -> Solution:
    """Continue a solution with an objective of wider bounds; the better one of both."""
    if np.array_equal(o.low, found.objective.low) or pace.late():
        return found
    further = found
    with contextlib.suppress(SolveError, np.linalg.LinAlgError):
        watch, p = pace.watch("wider bounds", 1.0), found.at.p.copy()
        p[list(o.free)] = np.where(o.low < found.objective.low, o.low, p[list(o.free)])
        further = _descended(o, replace(found.at, p=p), None, found.q, watch)
        further = _settled(o, further if asked is not None else _by_unit(o, further, 1.0, pace), pace)
    return min(further, found, key=lambda one: one.score)


def tightened(o: Objective, best: Solution) -> tuple[Point, Terms]:
    """The deterministic fit: from a solution on to practically no process noise.

    Raises:
        SolveError, numpy.linalg.LinAlgError: it does not converge.
    """
    at, terms, scales = best.at, best.terms, o.model.scales
    for level in (*LEVELS, TIGHT):
        q = np.minimum(best.q, level * scales)
        if (q < best.q).any():
            at, terms, _ = descend(o, at, q, precision=PRECISE, terms=terms)
    return at, terms


def marginal(o: Objective, at: Point, t: Terms, q: Array) -> float:
    """-2 log of the likelihood of the data with the states integrated out (Laplace), up to a constant.

    The states' volume and the process noise's normalisation balance, so that q can be chosen by it, as the
    diffusion in CTSM (Kristensen et al. 2004).
    """
    s = settled_system(o, at, t, q, np.zeros(len(o.free), dtype=bool))
    volume = 2.0 * float(np.log(s.factor[0]).sum())
    links = int(o.problem.linked.sum())
    return t.cost + volume + 2.0 * links * float(np.log(q / o.model.scales).sum())
