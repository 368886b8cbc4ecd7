"""Prediction error method with fixed filter gains: a search at a fraction of the cost of one on the likelihood.

Each model is corrected with the gains of a filter that has run already, on a simpler model or at other parameters,
instead of its own filter. Estimates from such innovations are consistent for any gains (Ljung, System Identification,
1999, section 8.4); the likelihood then starts from them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from optid.core.model import Array, Model
from optid.errors import SolveError
from optid.estimation.likelihood import FAR, Filtered, huber, run_fixed_gain_filter
from optid.estimation.likelihood_point import NUDGES, REACH, LikelihoodProblem
from optid.estimation.problem import Booleans

TOLERANCE = 1e-3  # of the loss, that a step must gain for the search to go on
# Damping factors, of the curvature: as many as a vector holds are tried at once. If the smallest or the largest is #
# best, the next ones are smaller or larger; if none succeeds, larger ones are tried.
DAMPINGS, PACE, FARTHER, TRIALS = (1e-4, 1e-2, 0.3, 10.0), (0.1, 1.0, 1.0, 10.0), 1e3, 2
# Of the largest curvature, added to that of each coordinate in the damping. A coordinate that a recording hardly #
# shows, as the height of a curve where the signal never was, then stays about where it is.
FLOOR = 1e-3
LOST = 1e3  # sd: an innovation of a model that has diverged


class FixedGainFit(NamedTuple):
    """The result of a search with fixed gains: the whole parameter vector, and Huber's loss of its innovations."""

    p: Array
    loss: float


def innovations(
    q: LikelihoodProblem,
    P: Array,
    plain: Model,
    guide: Filtered,
    only: Sequence[int] | None = None,
    resets: Booleans | None = None,
    among: Booleans | None = None,
) -> Array:
    """Innovations of parameter sets under fixed gains, in sd of the guide's, (sets, measured).

    Args:
        q: the likelihood problem.
        P: (sets, parameters).
        plain: model of the guide; its states are a subset of the likelihood problem's.
        guide: filter run whose gains and variances are used; its gains must be kept.
        only: segments to use; all if absent.
        resets: samples from which the following are predicted, (samples,); all if absent.
        among: samples that count, (samples,); all if absent.
    """
    names = [state.name for state in q.model.states]
    known = np.isfinite(guide.innovations[0])
    if only is not None:
        owner = np.repeat(np.arange(len(q.problem.counts)), q.problem.counts + 1)
        known = known & np.isin(owner, only)[:, None]
    if among is not None:
        known = known & among[:, None]
    common = [names.index(state.name) for state in plain.states]
    E = run_fixed_gain_filter(q.model, q.problem, P, guide, common, only=only, resets=resets)
    scaled = E[:, known] / np.sqrt(guide.variances[0][known])
    return np.asarray(np.nan_to_num(scaled, nan=LOST, posinf=LOST, neginf=-LOST))


def fixed_gain_fit(
    q: LikelihoodProblem,
    p: Array,
    plain: Model,
    guide: Filtered,
    steps: int,
    only: Sequence[int] | None = None,
    resets: Booleans | None = None,
    among: Booleans | None = None,
) -> FixedGainFit:
    """Minimise the innovations over the parameters, from a start, by Levenberg-Marquardt steps.

    Several dampings are tried at once: together they cost the time of one simulation, and no step is lost by being too
    long.

    Args:
        q: the likelihood problem.
        p: start, (parameters,).
        plain: model of the guide; its states are a subset of the likelihood problem's.
        guide: filter run whose gains and variances are used; its gains must be kept.
        steps: at most.
        only: segments to use; all if absent.
        resets, among: as for `innovations`.

    Raises:
        SolveError: the model cannot be simulated at the start.
    """
    free, low, high = list(q.free), q.low / q.typical, q.high / q.typical

    def residuals(X: Array) -> Array:
        """Innovations in sd, then deviations from the priors, (sets, rows), at free parameters in typical sizes."""
        P = np.tile(p, (len(X), 1))
        P[:, free] = np.clip(X * q.typical, q.low, q.high)
        prior = (X * q.typical - q.prior) / q.prior_sd
        return np.concatenate([innovations(q, P, plain, guide, only, resets, among), prior], axis=1)

    x = np.clip(p[free] / q.typical, low, high)
    (z,) = residuals(x[None])
    if not np.abs(z[: len(z) - len(x)]).min() < LOST:
        raise SolveError(
            "the simulation diverged at the start values (NaN or infinite); check them and their units"
        )
    loss, far, nudges = 0.5 * float(huber(z).sum()), 1.0, np.full(len(x), NUDGES[1])
    for _ in range(steps):
        moved = np.where(x + nudges > high, -nudges, nudges)
        J = ((residuals(x + np.diag(moved)) - z) / moved[:, None]).T
        nudges = np.clip(REACH / np.maximum(np.linalg.norm(J, axis=0), 1e-12), NUDGES[0], NUDGES[2])
        weight = np.minimum(1.0, FAR / np.maximum(np.abs(z), 1e-12))
        gradient, curvature = J.T @ (weight * z), (J.T * weight) @ J
        floor, before = FLOOR * np.diag(curvature).max(), loss
        for _ in range(TRIALS):
            ladder = [damped_step(gradient, curvature, far * by, x, low, high, floor) for by in DAMPINGS]
            X = np.clip(x + np.array(ladder), low, high)
            Z = residuals(X)
            losses = 0.5 * huber(Z).sum(axis=1)
            best = int(np.argmin(losses))
            if losses[best] < loss:
                x, z, loss = X[best], Z[best], float(losses[best])
                far *= PACE[best]
                break
            far *= FARTHER
        if before - loss < TOLERANCE * loss:
            break
    found = p.copy()
    found[free] = np.clip(x * q.typical, q.low, q.high)
    return FixedGainFit(found, loss)


def damped_step(
    gradient: Array,
    curvature: Array,
    damping: float,
    x: Array,
    low: Array,
    high: Array,
    floor: float = 0.0,
    held: Booleans | None = None,
) -> Array:
    """A Levenberg-Marquardt step, (coordinates,); a coordinate of x at a bound that it would leave is fixed.

    Each is damped by its own curvature and by a common `floor`; those `held` are fixed in any case.
    """
    held = np.zeros(len(gradient), dtype=np.bool_) if held is None else held.copy()
    while True:
        keep, step = ~held, np.zeros(len(gradient))
        H = curvature[np.ix_(keep, keep)]
        H = H + np.diag(damping * (np.diag(H) + floor) + 1e-12)
        step[keep] = -np.linalg.solve(H, gradient[keep])
        outward = ((x <= low) & (step < 0.0)) | ((x >= high) & (step > 0.0))
        if not outward.any():
            return step
        held |= outward
