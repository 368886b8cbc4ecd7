"""Prediction error method with fixed filter gains: a search at a fraction of the cost of one on the likelihood.

Each model is corrected with the gains of a filter that has run already, on a simpler model or at other parameters,
instead of its own filter. Estimates from such innovations are consistent for any gains (Ljung, System Identification,
1999, section 8.4); the likelihood then starts from them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from optid.core.model import Array, Model
from optid.errors import SolveError
from optid.estimation.likelihood import Filtered, broyden_formula, huber, huber_weight, run_fixed_gain_filter
from optid.estimation.likelihood_point import NUDGES, REACH, LikelihoodProblem
from optid.estimation.problem import Booleans, Integers

SETTLED = 5e-3  # of the loss, that a step must gain for the search to go on
# Damping factors, of the curvature: as many as a vector holds are tried at once. If the smallest or the largest is
# best, the next ones are smaller or larger; if none succeeds, larger ones are tried.
DAMPINGS, PACE, FARTHER, TRIALS = (1e-4, 1e-2, 0.3, 10.0), (0.1, 1.0, 1.0, 10.0), 1e3, 2
# Of the largest curvature, added to that of each coordinate in the damping. A coordinate that a recording hardly
# shows, as the height of a curve where the signal never was, then stays about where it is.
FLOOR = 1e-3
LOST = 1e3  # sd: an innovation of a model that has diverged
# Share of a step's change that its slopes may miss for the next step to update them (Broyden, Math. Comput. 19, 1965)
# instead of simulating every parameter's.
MISSED = 0.1


class FixedGainFit(NamedTuple):
    """The result of a search with fixed gains: the whole parameter vector, and Huber's loss of its innovations."""

    p: Array
    loss: float


@dataclass(frozen=True, eq=False)
class Residuals:
    """Innovations under fixed gains as functions of the free parameters, in typical sizes, and what priors add.

    Attributes:
        q: the likelihood problem.
        p: the whole parameter vector, of which the free ones are replaced.
        plain: model of the guide; its states are a subset of the likelihood problem's.
        guide: filter run whose gains and variances are used; its gains must be kept.
        resets: samples from which the following are predicted, (samples,); all if absent.
    """

    q: LikelihoodProblem
    p: Array
    plain: Model
    guide: Filtered
    resets: Booleans | None = None

    @property
    def start(self) -> Array:
        """The free parameters of the vector, within their bounds, (free,)."""
        return np.clip(self.p[list(self.q.free)] / self.q.typical, *self.bounds)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Of the free parameters."""
        return self.q.low / self.q.typical, self.q.high / self.q.typical

    def parameter_sets(self, X: Array) -> Array:
        """Whole parameter vectors of free parameters X (sets, free), (sets, parameters)."""
        P = np.tile(self.p, (len(X), 1))
        P[:, list(self.q.free)] = np.clip(X * self.q.typical, self.q.low, self.q.high)
        return P

    def at(self, X: Array) -> Array:
        """Innovations in sd, then deviations from the priors, (sets, rows)."""
        z = innovations(self.q, self.parameter_sets(X), self.plain, self.guide, resets=self.resets)
        return np.concatenate([z, (X * self.q.typical - self.q.prior) / self.q.prior_sd], axis=1)

    def jacobian(self, x: Array, z: Array, steps: Array) -> Array:
        """By finite differences at x, where the residuals are z, (rows, free)."""
        X, steps = self._displaced(x, steps)
        return ((self.at(X) - z) / steps[:, None]).T

    def linearised(self, x: Array) -> tuple[Array, Array]:
        """Residuals at x, (rows,), and their slopes, (rows, free), of one simulation."""
        X, steps = self._displaced(x, np.full(len(x), NUDGES[1]))
        Z = self.at(np.vstack([x, X]))
        return Z[0], ((Z[1:] - Z[0]) / steps[:, None]).T

    def _displaced(self, x: Array, steps: Array) -> tuple[Array, Array]:
        """Points a step of each parameter aside of x, within the bounds, (free, free), and these steps, (free,)."""
        steps = np.where(x + steps > self.bounds[1], -steps, steps)
        return x + np.diag(steps), steps

    def damped_points(
        self, x: Array, z: Array, J: Array, scale: float, counted: Booleans | None = None
    ) -> Array:
        """Points after a step with each damping factor, (dampings, free); `counted` rows decide, all if absent."""
        weight = huber_weight(z)
        if counted is not None:
            weight = np.where(counted, weight, 0.0)
        gradient, curvature = J.T @ (weight * z), (J.T * weight) @ J
        low, high = self.bounds
        floor = FLOOR * np.diag(curvature).max()
        steps = [damped_step(gradient, curvature, scale * by, x, low, high, floor) for by in DAMPINGS]
        return np.clip(x + np.array(steps), low, high)


def innovations(
    q: LikelihoodProblem,
    P: Array,
    plain: Model,
    guide: Filtered,
    only: Sequence[int] | None = None,
    resets: Booleans | None = None,
) -> Array:
    """Innovations of parameter sets under fixed gains, in sd of the guide's, (sets, measured).

    Args:
        q, plain, guide, resets: as of `Residuals`.
        P: (sets, parameters).
        only: segments to use; all if absent.
    """
    names = [state.name for state in q.model.states]
    known = np.isfinite(guide.innovations[0])
    if only is not None:
        owner = np.repeat(np.arange(len(q.problem.counts)), q.problem.counts + 1)
        known = known & np.isin(owner, only)[:, None]
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
    resets: Booleans | None = None,
) -> FixedGainFit:
    """Minimise the innovations over the parameters, from a start, by Levenberg-Marquardt steps.

    Several dampings are tried at once: together they cost the time of one simulation, and no step is lost by being too
    long. Slopes are simulated at the start, and again where a step shows that they no longer hold.

    Args:
        q, plain, guide, resets: as of `Residuals`.
        p: start, (parameters,).
        steps: at most.

    Raises:
        SolveError: the model cannot be simulated at the start.
    """
    residuals = Residuals(q, p, plain, guide, resets)
    x = residuals.start
    z, slopes = residuals.linearised(x)
    if not np.abs(z[: len(z) - len(x)]).min() < LOST:
        raise SolveError(
            "the simulation diverged at the start values (NaN or infinite); check them and their units"
        )
    loss, scale, nudges = 0.5 * float(huber(z).sum()), 1.0, _difference_steps(slopes)
    J: Array | None = slopes
    simulated = True
    for _ in range(steps):
        if J is None:
            J, simulated = residuals.jacobian(x, z, nudges), True
            nudges = _difference_steps(J)
        step = _levenberg_marquardt_step(residuals, x, z, loss, J, scale)
        if step is None and simulated:
            break
        if step is None:
            J = None
            continue
        before, J, simulated = loss, checked_broyden_update(J, step.x - x, step.z - z), False
        x, z, loss, scale = step
        if before - loss < SETTLED * loss:
            break
    return FixedGainFit(residuals.parameter_sets(x[None])[0], loss)


def _difference_steps(J: Array) -> Array:
    """Steps of each parameter for its finite difference that suit its slopes (rows, free)."""
    return np.asarray(np.clip(REACH / np.maximum(np.linalg.norm(J, axis=0), 1e-12), NUDGES[0], NUDGES[2]))


class _Step(NamedTuple):
    """Where a step leads: free parameters, residuals, loss, and the scale of the next one's dampings."""

    x: Array
    z: Array
    loss: float
    scale: float


def _levenberg_marquardt_step(
    residuals: Residuals, x: Array, z: Array, loss: float, J: Array, scale: float
) -> _Step | None:
    """The damped step with the smallest loss; ``None`` if none has a smaller one than x."""
    for _ in range(TRIALS):
        X = residuals.damped_points(x, z, J, scale)
        Z = residuals.at(X)
        losses = 0.5 * huber(Z).sum(axis=1)
        best = int(np.argmin(losses))
        if losses[best] < loss:
            return _Step(X[best], Z[best], float(losses[best]), scale * PACE[best])
        scale *= FARTHER
    return None


def checked_broyden_update(J: Array, step: Array, change: Array) -> Array | None:
    """The Jacobian after a step with this change of residuals; ``None`` where it missed too much of that."""
    if not np.linalg.norm(change - J @ step) <= MISSED * np.linalg.norm(change):
        return None
    return broyden_formula(J, step, change, np.sum(J**2, axis=0))


def cross_validated_residuals(residuals: Residuals, fold: Integers) -> Array:
    """Residuals of each fold with parameters fitted to all others by one step from the fit to everything, (measured,).

    The step with the damping that suits those others best, or none; the slopes are the same for all folds, so that
    these cost one simulation.

    Args:
        residuals: at parameters that were fitted to all samples.
        fold: of each measured value, (measured,); negative ones are predicted with the parameters as they are.
    """
    x = residuals.start
    z, J = residuals.linearised(x)
    numbers, rows = np.unique(fold[fold >= 0]), np.append(fold, np.full(len(x), -1))
    X = np.concatenate([residuals.damped_points(x, z, J, 1.0, rows != number) for number in numbers])
    Z, found = residuals.at(X).reshape(len(numbers), len(DAMPINGS), -1), z.copy()
    for number, tried in zip(numbers, Z, strict=True):
        candidates = np.vstack([z, tried])
        here = rows == number
        best = np.argmin(huber(candidates[:, ~here]).sum(axis=1))
        found[here] = candidates[best, here]
    return np.asarray(found[: len(fold)])


def damped_step(
    gradient: Array,
    curvature: Array,
    damping: float,
    x: Array,
    low: Array,
    high: Array,
    floor: float,
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
