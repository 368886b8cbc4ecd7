"""Maximum likelihood by Fisher scoring on the filter's innovations: parameters and process noise together.

Derivatives are differences of whole filters, one per parameter and level, and so dear. Once taken they are carried
along by Broyden's update (Mathematics of Computation 19, 1965), which costs nothing because every step shows how the
innovations moved; they are taken anew where a step keeps less than it promised, and before a search may end.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from optid.core.model import Array, Model
from optid.errors import SolveError
from optid.fit.likelihood import FAR, Filtered, Noise, deviance, noisy_states, run_filter
from optid.fit.objective import freed_with_rest, objective_of
from optid.fit.problem import Problem
from optid.rigs.rigfile import Rig

# Differences reach over REACH conditional standard deviations: dry friction makes the likelihood rough on the scale of
# a few (a break-away more or less), and a quotient over less would see nothing else.
REACH, NUDGES = 5.0, (1e-4, 1e-3, 3e-2)  # the least, the first and the largest, of a parameter's typical size
NUDGE_LEVEL = 0.1  # of the log of process noise
LEVELS = (math.log(1e-5), math.log(10.0))  # bounds of that log
FIRST = math.log(0.1)
ENOUGH = 1.0  # decrease of the score that ends the search, by a step on derivatives taken where it starts
NEARBY, ROUGH = 2e-3, 2e-2  # of the whole decrease: ends an approach, and a search that only ranks
TRIALS = (2, 5)  # of a step on carried and on fresh derivatives, with more and more damping
KEPT = 0.25  # of what a step promised: less, and carried derivatives are taken anew
APPROACH = 10  # iterations at the first level of process noise
RESTARTS = 2  # from other levels of process noise
SCAN = (-3.0, 0.0, 2.0)  # steps of a log level that are looked at


@dataclass(frozen=True, eq=False)
class Question:
    """What is asked of the data.

    Attributes:
        rig: model with parameters to start from.
        problem: the recordings, one window per segment.
        free: indices of the free parameters; low, high, typical, prior, prior_sd as in a batch fit.
        groups: states that share a level of process noise.
        measurement: variance of each output.
    """

    rig: Rig
    problem: Problem
    free: tuple[int, ...]
    low: Array
    high: Array
    typical: Array
    prior: Array
    prior_sd: Array
    groups: tuple[tuple[int, ...], ...]
    measurement: Array

    @property
    def model(self) -> Model:
        """The rig's model."""
        return self.rig.model


@dataclass(frozen=True, eq=False)
class Slopes:
    """Derivatives by free parameters in typical sizes and then by log levels, (samples, outputs, free + levels).

    Attributes:
        innovations: of the innovations.
        variances: of the log of their variances.
    """

    innovations: Array
    variances: Array


@dataclass(frozen=True, eq=False)
class Answer:
    """The likeliest parameters and process noise.

    Attributes:
        p: the whole parameter vector.
        noise: with the estimated levels.
        filtered: innovations, variances, states and gains there, sets = 1.
        score: -2 log likelihood with the priors, up to a constant of the data.
        slopes: of innovations and their variances.
        information: Fisher's, of free parameters in typical sizes and then of levels.
        settled: the iteration converged, on derivatives taken where it ended.
    """

    question: Question
    p: Array
    noise: Noise
    filtered: Filtered
    score: float
    slopes: Slopes
    information: Array
    settled: bool


def question_of(rig: Rig, problem: Problem, plain: Model | None = None) -> Question:
    """What the recordings are asked of everything that the rig frees; effects' states carry no process noise."""
    o, _ = objective_of(rig, freed_with_rest(rig), problem)
    names = None if plain is None else [state.name for state in plain.states]
    typical = [
        rig.model.parameters[i].typical if "." in rig.model.parameters[i].name else size
        for i, size in zip(o.free, o.typical, strict=True)
    ]
    return Question(
        rig, problem, o.free, o.low, o.high, np.array(typical), o.prior, o.prior_sd,
        noisy_states(rig.model, names), _measurement(o.weight),
    )  # fmt: skip


def _measurement(weight: Array) -> Array:
    return np.asarray(1.0 / weight[0] ** 2)


def maximise(
    q: Question,
    p: Array,
    levels: Array | None = None,
    *,
    iterations: int = 30,
    polish: bool = True,
    near: Answer | None = None,
) -> Answer:
    """From a start to the likeliest parameters and levels of process noise.

    Args:
        q: the question.
        p: start, (parameters,).
        levels: of the process noise to start from; without them the parameters are brought near at a middling
            level, where wrong ones are not yet taken for noise, see `approach`.
        iterations: at most.
        polish: end on derivatives taken there, and look at other levels of process noise.
        near: an answer of a like model on the same recordings; its derivatives are a start.

    Raises:
        SolveError: the model cannot be simulated at the start.
    """
    here = _start(q, p, np.full(len(q.groups), FIRST) if levels is None else levels)
    if levels is None:
        here, _, _ = _descend(here, APPROACH, NEARBY, held=True)
    here.begin(near)
    if not polish:
        here, _, settled = _descend(here, iterations, ROUGH, first=None if near is None else near.score)
        return here.answer(settled)
    here, used, settled = _descend(here, iterations)
    for _ in range(RESTARTS):
        other = _best_levels(here)
        if here.score - other.score < ENOUGH:
            break
        here, more, settled = _descend(other, max(iterations - used, 4))
        used += more
    return here.answer(settled)


def approach(q: Question, p: Array) -> Answer:
    """A few iterations from a start at a middling level of process noise: which of several starts is worth more.

    Raises:
        SolveError: the model cannot be simulated at the start.
    """
    here, _, settled = _descend(_start(q, p, np.full(len(q.groups), FIRST)), APPROACH, NEARBY, held=True)
    return here.answer(settled)


def tightened(answer: Answer, by: float, iterations: int) -> Answer:
    """The better of an answer and of what is found from it where the states may move less.

    Likelihoods in the level of process noise have two tops where physics is missing: one where the noise stands for
    it, and one where the model does. From the first the second is reached by fitting the parameters at a lower level.

    Args:
        answer: where to start from.
        by: how much lower the log levels are at first.
        iterations: at most, at the lower level and then with it free.
    """
    levels = np.maximum(answer.noise.levels - by, LEVELS[0])
    here = _Place(answer.question, answer.p, replace(answer.noise, levels=levels))
    if not math.isfinite(here.score):
        return answer
    here, _, _ = _descend(here, iterations, NEARBY, held=True)
    here, _, settled = _descend(here, iterations, ROUGH, first=answer.score)
    return here.answer(settled) if here.score < answer.score - ENOUGH else answer


def quieted(answer: Answer, by: float) -> Answer:
    """The same parameters where the states may move less: log levels of process noise lower by `by`."""
    for share in (1.0, 0.5, 0.25):
        levels = np.maximum(answer.noise.levels - share * by, LEVELS[0])
        here = _Place(answer.question, answer.p, replace(answer.noise, levels=levels))
        if math.isfinite(here.score):
            return here.answer(answer.settled)
    return answer


def _start(q: Question, p: Array, levels: Array) -> _Place:
    here = _Place(q, np.clip(p, *_bounds(q, p)), Noise(q.measurement, q.groups, levels))
    if not math.isfinite(here.score):
        raise SolveError("the simulation leaves the numbers at the start values; check them and their units")
    return here


def _descend(
    here: _Place, iterations: int, rough: float = 0.0, *, held: bool = False, first: float | None = None
) -> tuple[_Place, int, bool]:
    """Levenberg-Marquardt until a step gains too little; the place, the iterations used, whether it settled.

    Args:
        here: start.
        iterations: at most.
        rough: share of the decrease since `first` that is already too little; 0 ends on fresh derivatives only.
        held: keep the levels of process noise: the estimate is consistent at any (Ljung, System Identification,
            1999, section 8.4).
        first: the start's own score when absent.
    """
    damping, first = 1e-3, here.score if first is None else first
    for number in range(iterations):
        enough = max(ENOUGH, rough * (first - here.score))
        there, promised = _better(here, damping, held)
        if there is None:
            if here.fresh or (rough and here.score < first and 0.0 <= promised < enough):
                return here, number + 1, True
            here.differentiate()
            continue
        gain = here.score - there.score
        settled = gain < enough and (here.fresh or rough > 0.0)
        here = there
        if settled:
            return here, number + 1, True
        if gain < KEPT * promised or gain < enough:
            here.differentiate()
            damping = 1e-3
        damping /= 10.0
    return here, iterations, False


def _better(here: _Place, damping: float, held: bool) -> tuple[_Place | None, float]:
    """The first of a few ever more damped steps that lowers the score, and what it, or the first one, promised."""
    most = 0.0
    for trial in range(TRIALS[here.fresh]):
        gradient, information = here.expanded()
        there = here.moved(_step(here, gradient, information, damping, held))
        step = there.coordinates - here.coordinates
        promised = -float(step @ (2.0 * gradient + information @ step))
        slopes = here.carried(there, information)
        if there.score < here.score:
            there.slopes = slopes
            return there, promised
        if not here.fresh and math.isfinite(there.score):
            here.slopes = slopes
        most = promised if trial == 0 else most
        damping = max(damping * 20.0, 1e-2)
    return None, most


def _best_levels(here: _Place) -> _Place:
    """The best of the levels around these, one of them much smaller or larger: likelihoods in them have two tops."""
    q, count = here.q, len(here.q.groups)
    grid = np.array(list(itertools.product(SCAN, repeat=count)))
    grid = np.clip(here.noise.levels + grid[np.abs(grid).sum(axis=1) > 0], *LEVELS)
    Q = np.array([replace(here.noise, levels=levels).spectrum(len(q.model.states)) for levels in grid])
    P, R = np.tile(here.p, (len(grid), 1)), np.tile(here.noise.measurement, (len(grid), 1))
    f = run_filter(q.model, q.problem, P, Q, R)
    best = int(np.argmin(deviance(f.innovations, f.variances).sum(axis=-1)))
    return _Place(q, here.p, replace(here.noise, levels=grid[best]))


def _bounds(q: Question, p: Array) -> tuple[Array, Array]:
    low, high = np.full(len(p), -math.inf), np.full(len(p), math.inf)
    low[list(q.free)], high[list(q.free)] = q.low, q.high
    return low, high


class _Place:
    """A point of the search with its filter run; derivatives are taken there or carried there."""

    def __init__(self, q: Question, p: Array, noise: Noise) -> None:
        self.q, self.p, self.noise = q, p, noise
        nx = len(q.model.states)
        Q = noise.spectrum(nx)[None]
        self.filtered = run_filter(q.model, q.problem, p[None], Q, noise.measurement[None], keep=True)
        theta = p[list(q.free)]
        prior = float((((theta - q.prior) / q.prior_sd) ** 2).sum())
        total = float(deviance(self.filtered.innovations[0], self.filtered.variances[0]).sum()) + prior
        self.score = total if math.isfinite(total) else math.inf
        self.slopes: Slopes | None = None
        self.fresh = False  # the slopes were taken here

    @property
    def coordinates(self) -> Array:
        """Free parameters in typical sizes, then log levels."""
        return np.concatenate([self.p[list(self.q.free)] / self.q.typical, self.noise.levels])

    def moved(self, step: Array) -> _Place:
        nf = len(self.q.free)
        p = self.p.copy()
        theta = p[list(self.q.free)] + step[:nf] * self.q.typical
        p[list(self.q.free)] = np.clip(theta, self.q.low, self.q.high)
        levels = np.clip(self.noise.levels + np.clip(step[nf:], -1.5, 1.5), *LEVELS)
        return _Place(self.q, p, replace(self.noise, levels=levels))

    def begin(self, near: Answer | None) -> None:
        """Take over the slopes of a like model's answer, and take only those that it does not have."""
        if near is None:
            return
        names = [near.question.model.parameters[i].name for i in near.question.free]
        mine = [self.q.model.parameters[i].name for i in self.q.free]
        if near.question.groups != self.q.groups or not set(names) & set(mine):
            return
        nf, count = len(mine), len(mine) + len(self.q.groups)
        known = {name: k for k, name in enumerate(names)}
        given = [known.get(name, -1) for name in mine] + list(range(len(names), len(names) + count - nf))
        old, taken = near.slopes, [k for k, j in enumerate(given) if j >= 0]
        e, v = np.zeros((*old.innovations.shape[:2], count)), np.zeros((*old.innovations.shape[:2], count))
        source = [j for j in given if j >= 0]
        scale = np.ones(count)
        scale[:nf] = [
            1.0 if j < 0 else size / near.question.typical[j]
            for size, j in zip(self.q.typical, given[:nf], strict=True)
        ]
        e[..., taken], v[..., taken] = old.innovations[..., source], old.variances[..., source]
        self.slopes = Slopes(e * scale, v * scale)
        self.differentiate([k for k, j in enumerate(given) if j < 0])

    def differentiate(self, columns: Sequence[int] | None = None) -> None:
        """Take the slopes by filters beside this one; `columns` leaves the others as they are."""
        q, nx, nf = self.q, len(self.q.model.states), len(self.q.free)
        count = nf + len(q.groups)
        chosen = list(range(count)) if columns is None else list(columns)
        if not chosen:
            return
        P, R = np.tile(self.p, (len(chosen), 1)), np.tile(self.noise.measurement, (len(chosen), 1))
        Q, nudges = np.tile(self.noise.spectrum(nx), (len(chosen), 1)), self._nudges()[chosen]
        for row, k in enumerate(chosen):
            if k < nf:
                i = q.free[k]
                nudges[row] *= -1.0 if self.p[i] + nudges[row] * q.typical[k] > q.high[k] else 1.0
                P[row, i] += nudges[row] * q.typical[k]
            else:
                levels = self.noise.levels.copy()
                levels[k - nf] += nudges[row]
                Q[row] = replace(self.noise, levels=levels).spectrum(nx)
        other = run_filter(q.model, q.problem, P, Q, R)
        e, v = self.filtered.innovations[0], self.filtered.variances[0]
        de = np.moveaxis((other.innovations - e) / nudges[:, None, None], 0, -1)
        dv = np.moveaxis((np.log(other.variances) - np.log(v)) / nudges[:, None, None], 0, -1)
        if columns is None or self.slopes is None:
            self.slopes, self.fresh = Slopes(de, dv), True
        else:
            self.slopes.innovations[..., chosen] = de
            self.slopes.variances[..., chosen] = dv

    def _nudges(self) -> Array:
        """By how much each parameter, in typical sizes, and each level is moved for its difference quotient."""
        nf, ng = len(self.q.free), len(self.q.groups)
        if self.slopes is None:
            return np.concatenate([np.full(nf, NUDGES[1]), np.full(ng, NUDGE_LEVEL)])
        size = np.sqrt(np.diag(self.expanded()[1])[:nf])
        known = np.clip(REACH / np.maximum(size, 1e-12), NUDGES[0], NUDGES[2])
        return np.concatenate([known, np.full(ng, NUDGE_LEVEL)])

    def carried(self, there: _Place, information: Array) -> Slopes:
        """Broyden's update of the slopes by what a step showed, in the metric in which all parameters count alike."""
        assert self.slopes is not None
        s = there.coordinates - self.coordinates
        along = np.diag(information) * s
        length = float(s @ along)
        if not length > 0.0:
            return self.slopes
        old, new = self.filtered, there.filtered
        missed_e = new.innovations[0] - old.innovations[0] - self.slopes.innovations @ s
        missed_v = np.log(new.variances[0] / old.variances[0]) - self.slopes.variances @ s
        update = along / length
        return Slopes(
            self.slopes.innovations + missed_e[..., None] * update,
            self.slopes.variances + missed_v[..., None] * update,
        )

    def expanded(self) -> tuple[Array, Array]:
        """Gradient of half the score and Fisher's information, in typical sizes and log levels."""
        if self.slopes is None:
            self.differentiate()
        assert self.slopes is not None
        q, nf = self.q, len(self.q.free)
        e, v = self.filtered.innovations[0], self.filtered.variances[0]
        known = np.isfinite(e) & np.isfinite(self.slopes.innovations).all(axis=-1)
        sd = np.sqrt(v[known])
        z, D = e[known] / sd, self.slopes.variances[known]
        J = self.slopes.innovations[known] / sd[:, None]
        weight = np.minimum(1.0, FAR / np.maximum(np.abs(z), 1e-12))
        gradient = J.T @ (weight * z) + 0.5 * D.T @ (1.0 - weight * z**2)
        information = J.T @ (J * weight[:, None]) + 0.5 * D.T @ D
        prior = (q.typical / q.prior_sd) ** 2
        gradient[:nf] += (self.p[list(q.free)] - q.prior) / q.typical * prior
        information[range(nf), range(nf)] += prior
        return gradient, information

    def answer(self, settled: bool) -> Answer:
        """What was found here."""
        _, information = self.expanded()
        assert self.slopes is not None
        return Answer(
            self.q, self.p, self.noise, self.filtered, self.score, self.slopes, information, settled
        )


def _step(here: _Place, gradient: Array, information: Array, damping: float, levels_held: bool) -> Array:
    """The damped scoring step; parameters that would leave their bounds stay."""
    q, nf = here.q, len(here.q.free)
    theta = here.p[list(q.free)]
    held = np.zeros(len(gradient), dtype=bool)
    held[nf:] = levels_held
    for _ in range(nf + 1):
        keep = ~held
        H = information[np.ix_(keep, keep)]
        H = H + np.diag(damping * np.diag(H) + 1e-12)
        step = np.zeros(len(gradient))
        step[keep] = -np.linalg.solve(H, gradient[keep])
        outward = ((theta <= q.low) & (step[:nf] < 0)) | ((theta >= q.high) & (step[:nf] > 0))
        new = outward & ~held[:nf]
        if not new.any():
            break
        held[:nf] |= outward
    return step
