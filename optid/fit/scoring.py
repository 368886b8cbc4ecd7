"""Maximum likelihood by Fisher scoring on the filter's innovations: parameters and process noise together.

The first iterations take the parameters' derivatives with the filter's gains held, as the prediction-error methods
for the innovations form do (Ljung, System Identification, 1999, section 9.4): one plain simulation a parameter.
Where that is not good enough, and for what is reported, every derivative is a difference of two filters.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np

from optid.core.model import Array, Model
from optid.errors import SolveError
from optid.fit.likelihood import FAR, Filtered, Noise, deviance, noisy_states, run_filter, run_steered
from optid.fit.objective import freed_with_rest, objective_of
from optid.fit.problem import Problem
from optid.rigs.rigfile import Rig

NUDGE = 1e-3  # of a parameter's typical size: the difference quotient of its innovations
NUDGE_LEVEL = 0.1  # of the log of process noise
LEVELS = (math.log(1e-6), math.log(10.0))  # bounds of that log
FIRST = math.log(0.1)
ENOUGH = 0.5  # decrease of the score that ends the search
TRIALS = 5  # of a step, with more and more damping
KEPT = 0.5  # of what a step on cheap derivatives promised: less, and they are not trusted any more
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
class Answer:
    """The likeliest parameters and process noise.

    Attributes:
        p: the whole parameter vector.
        noise: with the estimated levels.
        filtered: innovations, variances, states and gains there, sets = 1.
        score: -2 log likelihood with the priors, up to a constant of the data.
        slopes: derivatives of the innovations by the free parameters' typical sizes, (samples, outputs, free).
        information: Fisher's, of free parameters in typical sizes and then of levels.
        settled: the iteration converged.
    """

    question: Question
    p: Array
    noise: Noise
    filtered: Filtered
    score: float
    slopes: Array
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
    q: Question, p: Array, levels: Array | None = None, *, iterations: int = 30, polish: bool = True
) -> Answer:
    """From a start to the likeliest parameters and levels of process noise.

    Args:
        q: the question.
        p: start, (parameters,).
        levels: of the process noise to start from; without them the parameters are first brought near at a
            middling level, where wrong ones are not yet taken for noise.
        iterations: at most.
        polish: end on exact derivatives, and look at other levels of process noise.

    Raises:
        SolveError: the model cannot be simulated at the start.
    """
    noise = Noise(q.measurement, q.groups, np.full(len(q.groups), FIRST) if levels is None else levels)
    here = _Place(q, np.clip(p, *_bounds(q, p)), noise)
    if not math.isfinite(here.score):
        raise SolveError("the simulation leaves the numbers at the start values; check them and their units")
    if levels is None:
        here, _, _ = _descend(here, APPROACH, False, held=True)
    here, used, settled = _descend(here, iterations, polish)
    for _ in range(RESTARTS if polish else 0):
        other = _best_levels(here)
        if here.score - other.score < ENOUGH:
            break
        here, more, settled = _descend(other, max(iterations - used, 4), polish)
        used += more
    _, information = here.expand(True)
    return Answer(q, here.p, here.noise, here.filtered, here.score, here.slopes, information, settled)


def quieted(answer: Answer, by: float) -> Answer:
    """The same parameters where the states may move less: log levels of process noise lower by `by`."""
    q = answer.question
    here = _Place(q, answer.p, replace(answer.noise, levels=np.maximum(answer.noise.levels - by, LEVELS[0])))
    _, information = here.expand(True)
    return Answer(q, here.p, here.noise, here.filtered, here.score, here.slopes, information, answer.settled)


def _descend(here: _Place, iterations: int, polish: bool, held: bool = False) -> tuple[_Place, int, bool]:
    """Levenberg-Marquardt until a step gains too little; the place, the iterations used, whether it settled.

    `held` keeps the levels of process noise: the estimate is consistent at any (Ljung 1999, section 8.4).
    Derivatives with held gains are cheap, and useless where a model with held gains does not follow the data: after
    the first step that keeps less than it promised, every derivative has a filter of its own.
    """
    damping, exact = 1e-3, False
    for number in range(iterations):
        gradient, information = here.expand(exact)
        there, promised = None, 0.0
        for _ in range(TRIALS if exact else 1):
            step = _step(here, gradient, information, damping, held)
            trial = here.moved(step)
            if trial.score < here.score:
                there, promised = trial, -float(step @ (2.0 * gradient + information @ step))
                break
            damping = max(damping * 20.0, 1e-2)
        if there is None:
            if exact:
                return here, number + 1, True
            damping, exact = 1e-3, True
            continue
        gain, here = here.score - there.score, there
        if gain < ENOUGH and (exact or not polish):
            return here, number + 1, True
        if gain < KEPT * promised or gain < ENOUGH:
            exact = True
        damping /= 10.0
    return here, iterations, False


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
    """A point of the search with its filter run; derivatives on request."""

    def __init__(self, q: Question, p: Array, noise: Noise) -> None:
        self.q, self.p, self.noise = q, p, noise
        nx = len(q.model.states)
        Q = noise.spectrum(nx)[None]
        self.filtered = run_filter(q.model, q.problem, p[None], Q, noise.measurement[None], keep=True)
        theta = p[list(q.free)]
        prior = float((((theta - q.prior) / q.prior_sd) ** 2).sum())
        total = float(deviance(self.filtered.innovations[0], self.filtered.variances[0]).sum()) + prior
        self.score = total if math.isfinite(total) else math.inf

    def moved(self, step: Array) -> _Place:
        nf = len(self.q.free)
        p = self.p.copy()
        theta = p[list(self.q.free)] + step[:nf] * self.q.typical
        p[list(self.q.free)] = np.clip(theta, self.q.low, self.q.high)
        levels = np.clip(self.noise.levels + np.clip(step[nf:], -1.5, 1.5), *LEVELS)
        return _Place(self.q, p, replace(self.noise, levels=levels))

    def expand(self, exact: bool) -> tuple[Array, Array]:
        """Gradient of half the score and Fisher's information, in typical sizes and log levels.

        Args:
            exact: parameters' derivatives from filters of their own, instead of with the gains held.
        """
        q, nx = self.q, len(self.q.model.states)
        nf, ng = len(q.free), len(q.groups)
        nudges = np.where(self.p[list(q.free)] + NUDGE * q.typical > q.high, -NUDGE, NUDGE)
        P = np.tile(self.p, (nf, 1))
        P[range(nf), list(q.free)] += nudges * q.typical
        e, v = self.filtered.innovations[0], self.filtered.variances[0]
        if not exact:
            runs = run_steered(q.model, q.problem, np.vstack([self.p, P]), self.filtered.gains[0], range(nx))
            runs[~np.isfinite(runs)] = np.nan  # a model with held gains may leave the numbers
            self.slopes = np.moveaxis((runs[1:] - runs[:1]) / nudges[:, None, None], 0, -1)
        levels = np.tile(self.noise.levels, (ng, 1)) + NUDGE_LEVEL * np.eye(ng)
        Q = [replace(self.noise, levels=one).spectrum(nx) for one in levels]
        sets, own = np.tile(self.p, (ng, 1)), self.noise.spectrum(nx)
        if exact:
            sets, Q, nudges = np.vstack([P, sets]), [own] * nf + Q, np.r_[nudges, [NUDGE_LEVEL] * ng]
        else:
            nudges = np.full(ng, NUDGE_LEVEL)
        R = np.tile(self.noise.measurement, (len(sets), 1))
        other = run_filter(q.model, q.problem, sets, np.array(Q), R)
        de = np.moveaxis((other.innovations - e) / nudges[:, None, None], 0, -1)
        dv = np.moveaxis((np.log(other.variances) - np.log(v)) / nudges[:, None, None], 0, -1)
        if exact:
            self.slopes = de[..., :nf]
        else:
            de = np.concatenate([self.slopes, de], axis=-1)
            dv = np.concatenate([np.zeros_like(self.slopes), dv], axis=-1)
        known = np.isfinite(e) & np.isfinite(de).all(axis=-1)
        sd = np.sqrt(v[known])
        z, J, D = e[known] / sd, de[known] / sd[:, None], dv[known]
        weight = np.minimum(1.0, FAR / np.maximum(np.abs(z), 1e-12))
        gradient = J.T @ (weight * z) + 0.5 * D.T @ (1.0 - weight * z**2)
        information = J.T @ (J * weight[:, None]) + 0.5 * D.T @ D
        prior = (q.typical / q.prior_sd) ** 2
        gradient[:nf] += (self.p[list(q.free)] - q.prior) / q.typical * prior
        information[range(nf), range(nf)] += prior
        return gradient, information


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
