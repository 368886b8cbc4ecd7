"""Maximum likelihood by Fisher scoring on the filter's innovations: parameters and process noise together.

Derivatives are differences of whole filter runs, one per parameter and level, and therefore expensive. They are then
updated by Broyden's formula (Mathematics of Computation 19, 1965) at no cost, since every step shows how the
innovations moved, and computed again where a step gains less than predicted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from optid.core.model import Array, Model
from optid.errors import SolveError
from optid.estimation.fixed_gain import damped_step
from optid.estimation.likelihood import Noise, deviance, noisy_states, run_filter
from optid.estimation.likelihood_point import LEVELS, LikelihoodFit, LikelihoodPoint, LikelihoodProblem
from optid.estimation.objective import objective_of, with_nuisance_parameters
from optid.estimation.problem import Problem
from optid.rigs.rigfile import Rig

MIDDLING = 3e-3  # of their usual sizes: start value of the process noise per sample
ENOUGH, MOST = 1.0, 30  # decrease of the score that ends the search, and largest number of iterations
TRIALS = (2, 5)  # trials of a step with updated and with new derivatives, with increasing damping
KEPT = 0.25  # of the predicted gain of a step: for less, updated derivatives are computed again


def likelihood_problem(
    rig: Rig, problem: Problem, plain: Model | None = None, misfit: Mapping[str, float] | None = None
) -> LikelihoodProblem:
    """The likelihood problem of all parameters that the rig fits; effects' states have no process noise.

    With `misfit`, by role, the model is simulated: no state has process noise, and the misfit counts as measurement
    noise.
    """
    o, _ = objective_of(rig, with_nuisance_parameters(rig, by_filter=True), problem)
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
    return LikelihoodProblem(
        rig, problem, o.free, o.low, o.high, np.array(typical), o.prior, o.prior_sd, groups, measurement
    )


def point_at(q: LikelihoodProblem, p: Array, levels: Array) -> LikelihoodPoint:
    """The point of a search at these parameters, clipped to their bounds, and levels of process noise.

    Raises:
        SolveError: the model cannot be simulated there.
    """
    here = LikelihoodPoint(q, np.clip(p, *_bounds(q, p)), Noise(q.measurement, q.groups, levels))
    if not math.isfinite(here.score):
        raise SolveError("the simulation diverged at the start values; check them and their units")
    return here


def maximise(here: LikelihoodPoint) -> LikelihoodFit:
    """Maximise the likelihood over parameters and levels of process noise, by Levenberg-Marquardt steps.

    Derivatives are computed at the end, so that the information belongs to the result.
    """
    here, settled = _descend(here)
    if not here.fresh or here.glanced:
        here.differentiate()
    return here.as_fit(settled)


def _descend(here: LikelihoodPoint) -> tuple[LikelihoodPoint, bool]:
    """The end of the iteration, and whether the last step gained too little to continue."""
    first, damping = here.score, 1e-3
    if here.slopes is None:
        here.fixed_gain_jacobian()
    for _ in range(MOST):
        if here.q.budget.is_over:
            return here, False
        there, promised = _better(here, damping)
        if there is None:
            if (here.fresh and not here.glanced) or (here.score < first and 0.0 <= promised < ENOUGH):
                return here, True
            if here.fresh:  # if fixed gains give no descent, derivatives of whole filters do
                here.differentiate()
            else:
                here.fixed_gain_jacobian()
            continue
        gain, here = here.score - there.score, there
        if gain < ENOUGH:
            return here, True
        if gain < KEPT * promised:
            here.fixed_gain_jacobian()
            damping = 1e-3
        damping /= 10.0
    return here, False


def default_process_noise(q: LikelihoodProblem) -> Array:
    """Start values of the log levels of process noise, per sample, so that slow and fast plants start alike."""
    level = math.log(MIDDLING / math.sqrt(float(np.median(q.problem.dt))))
    return np.full(len(q.groups), min(max(level, LEVELS[0]), LEVELS[1]))


def noise_levels(q: LikelihoodProblem) -> list[Array]:
    """Log levels of process noise, the same for all groups, over their whole range in unit steps, each (groups,)."""
    return [np.full(len(q.groups), level) for level in np.arange(*LEVELS)]


def successive_halving(q: LikelihoodProblem, starts: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
    """The most likely of several starts, each a parameter vector and levels of process noise.

    Raises:
        SolveError: the model cannot be simulated at any of them.
    """
    pairs = [(p, np.clip(levels, *LEVELS)) for p, levels in starts]
    return pairs[_race(q, np.array([p for p, _ in pairs]), np.array([levels for _, levels in pairs]))]


def _race(q: LikelihoodProblem, P: Array, levels: Array) -> int:
    """The most likely of parameters (sets, parameters) and levels (sets, groups), without priors.

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
                "the simulation diverged at the start values (NaN or infinite); check them and their units"
            )
        order = np.argsort(scores[ahead], kind="stable")
        ahead = ahead[order[: max(1, -(-len(order) // 2))]]
        if len(ahead) == 1:
            break
    return int(ahead[0])


def _better(here: LikelihoodPoint, damping: float) -> tuple[LikelihoodPoint | None, float]:
    """The first of a few increasingly damped steps that lowers the score, and its predicted gain, or the first's."""
    most = 0.0
    for trial in range(TRIALS[here.fresh]):
        gradient, information = here.gradient_and_fisher()
        there = here.moved(_step(here, gradient, information, damping))
        step = there.coordinates - here.coordinates
        promised = -float(step @ (2.0 * gradient + information @ step))
        if math.isfinite(there.score):  # a step at which the model diverges gives no information
            slopes = here.broyden_update(there, information)
            if there.score < here.score:
                there.slopes = slopes
                return there, promised
            if not here.fresh:
                here.slopes = slopes
        most = promised if trial == 0 else most
        damping = max(damping * 20.0, 1e-2)
    return None, most


def _bounds(q: LikelihoodProblem, p: Array) -> tuple[Array, Array]:
    low, high = np.full(len(p), -math.inf), np.full(len(p), math.inf)
    low[list(q.free)], high[list(q.free)] = q.low, q.high
    return low, high


def _step(here: LikelihoodPoint, gradient: Array, information: Array, damping: float) -> Array:
    """The damped scoring step; parameters that would leave their bounds are fixed."""
    q, levels = here.q, here.noise.levels
    free = np.full(len(levels), math.inf)  # levels are clipped where they are used
    x = np.concatenate([here.p[list(q.free)], levels])
    low, high = np.concatenate([q.low, -free]), np.concatenate([q.high, free])
    return damped_step(gradient, information, damping, x, low, high, floor=0.0)
