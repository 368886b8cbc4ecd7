"""Maximum likelihood by Fisher scoring on the filter's innovations: parameters and process noise together.

Derivatives are differences of whole filters, one per parameter and level, and so dear. Once taken they are carried
along by Broyden's update (Mathematics of Computation 19, 1965), which costs nothing because every step shows how the
innovations moved; they are taken anew where a step keeps less than it promised, and before a search may end.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from optid.core.model import Array, Model
from optid.errors import SolveError
from optid.estimation.likelihood import Noise, deviance, noisy_states, run_filter
from optid.estimation.objective import freed_with_rest, objective_of
from optid.estimation.place import LEVELS, Answer, Place, Question
from optid.estimation.problem import Problem
from optid.estimation.simplex import FEW, around
from optid.estimation.steering import STEPS, damped_step, steered_fit
from optid.rigs.rigfile import Rig

MIDDLING = 3e-3  # of their usual sizes: what process noise moves states by from sample to sample where a search begins
ENOUGH = 1.0  # decrease of the score that ends the search, by a step on derivatives taken where it starts
NEARBY, ROUGH = 2e-3, 2e-2  # of the whole decrease: ends an approach, and a search that only ranks
TRIALS = (2, 5)  # of a step on carried and on fresh derivatives, with more and more damping
KEPT = 0.25  # of what a step promised: less, and carried derivatives are taken anew
LED = 3  # times at most that a start is led by the gains of the filter run before
PACE = 3  # steps by whose best a search is judged that is to reach a goal: one on stale derivatives may gain little
APPROACH = 10  # iterations at the first level of process noise
RESTARTS = 2  # from other levels of process noise
SCAN = (-3.0, 0.0, 2.0)  # steps of a log level that are looked at


def question_of(
    rig: Rig, problem: Problem, plain: Model | None = None, misfit: Mapping[str, float] | None = None
) -> Question:
    """What the recordings are asked of everything that the rig frees; effects' states carry no process noise.

    With `misfit`, by role, the model is asked for a simulation: no state carries any, and it counts as the
    measurement's noise.
    """
    o, _ = objective_of(rig, freed_with_rest(rig, contact=True), problem)
    names = None if plain is None else [state.name for state in plain.states]
    typical = [
        rig.model.parameters[i].typical if "." in rig.model.parameters[i].name else size
        for i, size in zip(o.free, o.typical, strict=True)
    ]
    measurement, groups = 1.0 / o.weight[0] ** 2, noisy_states(rig.model, names)
    if misfit is not None:
        groups = ()
        for j, port in enumerate(rig.model.outputs):
            measurement[j] = misfit.get(port.role, math.sqrt(measurement[j])) ** 2
    return Question(
        rig, problem, o.free, o.low, o.high, np.array(typical), o.prior, o.prior_sd, groups, measurement
    )


def maximise(
    q: Question,
    p: Array,
    levels: Array | None = None,
    *,
    iterations: int = 30,
    polish: bool = True,
    rough: float = ROUGH,
    near: Answer | None = None,
    since: float | None = None,
    glances: bool = False,
    goal: float = math.inf,
) -> Answer:
    """From a start to the likeliest parameters and levels of process noise.

    Args:
        q: the question.
        p: start, (parameters,).
        levels: of the process noise to start from; without them the parameters are brought near at a middling
            level, where wrong ones are not yet taken for noise, see `approach`.
        iterations: at most.
        polish: end on derivatives taken there, and look at other levels of process noise.
        rough: without that, the share of the whole decrease that ends the search.
        near: an answer of a like model on the same recordings; its derivatives are a start.
        since: score that the whole decrease counts from; that of `near`, or else the start's, if absent.
        glances: without polish, end also where held gains do not show the way: whole filters could, at their price.
        goal: score without which the answer is of no use: the search ends where it falls out of reach, see `_descend`.

    Raises:
        SolveError: the model cannot be simulated at the start.
    """
    here = _start(q, p, middling(q) if levels is None else levels)
    if levels is None:
        here, _, _ = _descend(_led(here), APPROACH, NEARBY, held=True)
    if len(q.problem.time) <= FEW:
        here = around(here)
    if not polish:
        if near is not None:
            since = near.score if since is None else since
            if near.question.free == here.q.free:  # else a glance from here costs less and shows more
                here.begin(near)
        here, _, settled = _descend(here, iterations, rough, first=since, glances=glances, goal=goal)
        return here.answer(settled)
    here.begin(near)
    here, used, settled = _descend(here, iterations, goal=goal)
    for _ in range(RESTARTS):
        if q.over or here.score > goal:
            break
        other = _best_levels(here)
        if here.score - other.score < ENOUGH:
            break
        here, more, settled = _descend(other, max(iterations - used, 4), goal=goal)
        used += more
    return here.answer(settled)


def _led(here: Place) -> Place:
    """Where held gains lead from a place, and from there once more, as long as that is likelier."""
    for _ in range(LED):
        p = steered_fit(here.q, here.p, here.q.model, here.filtered, STEPS).p
        there = Place(here.q, p, here.noise)
        if not there.score < here.score - ENOUGH:
            break
        here = there
    return here


def middling(q: Question) -> Array:
    """Log levels of process noise to begin with: by the sample, so that slow plants and fast ones begin alike."""
    level = math.log(MIDDLING / math.sqrt(float(np.median(q.problem.dt))))
    return np.full(len(q.groups), min(max(level, LEVELS[0]), LEVELS[1]))


def likeliest(q: Question, starts: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
    """The likeliest of some starts, each a parameter vector and levels of process noise.

    Raises:
        SolveError: the model cannot be simulated at any of them.
    """
    pairs = [(p, np.clip(levels, *LEVELS)) for p, levels in starts]
    return pairs[_race(q, np.array([p for p, _ in pairs]), np.array([levels for _, levels in pairs]))]


def _race(q: Question, P: Array, levels: Array) -> int:
    """The likeliest of parameters (sets, parameters) and levels (sets, groups); priors do not count.

    All run over the longest segment of the data, the better half of them over the next, and so on.

    Raises:
        SolveError: the model cannot be simulated at any of them.
    """
    noise = Noise(q.measurement, q.groups, levels[0])
    Q = np.array([replace(noise, levels=one).spectrum(len(q.model.states)) for one in levels])
    ahead, scores = np.arange(len(P)), np.zeros(len(P))
    for segment in np.argsort(-q.problem.counts, kind="stable"):
        R = np.tile(q.measurement, (len(ahead), 1))
        f = run_filter(q.model, q.problem, P[ahead], Q[ahead], R, only=[int(segment)])
        scores[ahead] += deviance(f.innovations, f.variances).sum(axis=-1)
        ahead = ahead[np.isfinite(scores[ahead])]
        if not len(ahead):
            raise SolveError(
                "the simulation leaves the numbers at the start values; check them and their units"
            )
        order = np.argsort(scores[ahead], kind="stable")
        ahead = ahead[order[: max(1, -(-len(order) // 2))]]
        if len(ahead) == 1:
            break
    return int(ahead[0])


def _start(q: Question, p: Array, levels: Array) -> Place:
    here = Place(q, np.clip(p, *_bounds(q, p)), Noise(q.measurement, q.groups, levels))
    if not math.isfinite(here.score):
        raise SolveError("the simulation leaves the numbers at the start values; check them and their units")
    return here


def _descend(
    here: Place,
    iterations: int,
    rough: float = 0.0,
    *,
    held: bool = False,
    first: float | None = None,
    glances: bool = False,
    goal: float = math.inf,
) -> tuple[Place, int, bool]:
    """Levenberg-Marquardt until a step gains too little; the place, the iterations used, whether it settled.

    Args:
        here: start.
        iterations: at most.
        rough: share of the decrease since `first` that is already too little; 0 ends on fresh derivatives only.
        held: keep the levels of process noise: the estimate is consistent at any (Ljung, System Identification,
            1999, section 8.4).
        first: the start's own score when absent.
        glances: see `maximise`.
        goal: it ends, too, where the iterations left would not lead below this score if each gained as much as the
            best of the last PACE.
    """
    gains: list[float] = []
    damping, first = 1e-3, here.score if first is None else first
    look = Place.glance if rough else Place.differentiate
    if here.slopes is None:
        look(here)
    for number in range(iterations):
        if here.q.over:
            return here, number, False
        enough = max(ENOUGH, rough * abs(first - here.score))
        there, promised = _better(here, damping, held)
        if there is None:
            if (here.fresh and (glances or not here.glanced)) or (
                rough and here.score < first and 0.0 <= promised < enough
            ):
                return here, number + 1, True
            if here.fresh:  # held gains do not show the way: whole filters do
                here.differentiate()
            else:
                look(here)
            continue
        gain = here.score - there.score
        settled = gain < enough and (here.fresh or rough > 0.0)
        here = there
        if settled:
            return here, number + 1, True
        gains.append(gain)
        reach = max(gains[-PACE:]) * (iterations - number - 1)
        if len(gains) >= PACE and here.score - reach > goal:
            return here, number + 1, False
        if gain < KEPT * promised or gain < enough:
            look(here)
            damping = 1e-3
        damping /= 10.0
    return here, iterations, False


def _better(here: Place, damping: float, held: bool) -> tuple[Place | None, float]:
    """The first of a few ever more damped steps that lowers the score, and what it, or the first one, promised."""
    most = 0.0
    for trial in range(TRIALS[here.fresh]):
        gradient, information = here.expanded()
        there = here.moved(_step(here, gradient, information, damping, held))
        step = there.coordinates - here.coordinates
        promised = -float(step @ (2.0 * gradient + information @ step))
        if math.isfinite(there.score):  # where a model leaves the numbers a step shows nothing
            slopes = here.carried(there, information)
            if there.score < here.score:
                there.slopes = slopes
                return there, promised
            if not here.fresh:
                here.slopes = slopes
        most = promised if trial == 0 else most
        damping = max(damping * 20.0, 1e-2)
    return None, most


def _best_levels(here: Place) -> Place:
    """The best of the levels around these, one of them much smaller or larger: likelihoods in them have two tops."""
    q, count = here.q, len(here.q.groups)
    if not count:
        return here
    grid = np.array(list(itertools.product(SCAN, repeat=count)))
    grid = np.clip(here.noise.levels + grid[np.abs(grid).sum(axis=1) > 0], *LEVELS)
    try:
        best = _race(q, np.tile(here.p, (len(grid), 1)), grid)
    except SolveError:
        return here
    return Place(q, here.p, replace(here.noise, levels=grid[best]))


def _bounds(q: Question, p: Array) -> tuple[Array, Array]:
    low, high = np.full(len(p), -math.inf), np.full(len(p), math.inf)
    low[list(q.free)], high[list(q.free)] = q.low, q.high
    return low, high


def _step(here: Place, gradient: Array, information: Array, damping: float, levels_held: bool) -> Array:
    """The damped scoring step; parameters that would leave their bounds stay."""
    q, levels = here.q, here.noise.levels
    free = np.full(len(levels), math.inf)  # levels are clipped where they are used
    x, held = np.concatenate([here.p[list(q.free)], levels]), np.zeros(len(gradient), dtype=np.bool_)
    held[len(q.free) :] = levels_held
    low, high = np.concatenate([q.low, -free]), np.concatenate([q.high, free])
    return damped_step(gradient, information, damping, x, low, high, held=held)
