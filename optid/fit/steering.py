"""Parameters by prediction error under held gains: a search that costs a fraction of one on the filter's likelihood.

Each model follows the recordings by the gains of a filter that has run already, on a plainer model or at other
parameters, instead of by a filter of its own. Estimates by such innovations are consistent at any gains (Ljung, System
Identification, 1999, section 8.4); the likelihood then takes them as a start.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from optid.core.model import Array, Model
from optid.errors import SolveError
from optid.fit.likelihood import FAR, Filtered, huber, run_steered
from optid.fit.place import NUDGES, REACH, Question
from optid.fit.problem import Booleans

TOLERANCE = 1e-3  # of the loss, that a step must gain for the search to go on
LOST = 1e3  # sd: an innovation of a model that has left the numbers


class Steered(NamedTuple):
    """Where a search under held gains ended: the whole parameter vector, and Huber's loss of the innovations there."""

    p: Array
    loss: float


def innovations(
    q: Question,
    P: Array,
    plain: Model,
    guide: Filtered,
    only: Sequence[int] | None = None,
    looks: Booleans | None = None,
) -> Array:
    """Innovations of parameter sets under held gains, in sd of the guide's, (sets, measured).

    Args:
        q: the question.
        P: (sets, parameters).
        plain: model of the guide, whose states are among the question's.
        guide: whose gains and variances hold, with gains kept.
        only: what was measured in these segments, in all if absent.
        looks: samples from which the others are predicted, (samples,); all if absent.
    """
    names = [state.name for state in q.model.states]
    known = np.isfinite(guide.innovations[0])
    if only is not None:
        owner = np.repeat(np.arange(len(q.problem.counts)), q.problem.counts + 1)
        known = known & np.isin(owner, only)[:, None]
    common = [names.index(state.name) for state in plain.states]
    E = run_steered(q.model, q.problem, P, guide, common, only=only, looks=looks)
    scaled = E[:, known] / np.sqrt(guide.variances[0][known])
    return np.asarray(np.nan_to_num(scaled, nan=LOST, posinf=LOST, neginf=-LOST))


def steered_fit(
    q: Question,
    p: Array,
    plain: Model,
    guide: Filtered,
    iterations: int,
    only: Sequence[int] | None = None,
    looks: Booleans | None = None,
) -> Steered:
    """The parameters under which innovations are least, from a start.

    Args:
        q: the question.
        p: start, (parameters,).
        plain: model of the guide, whose states are among the question's.
        guide: whose gains and variances hold, with gains kept.
        iterations: evaluations at most.
        only: these segments count, all if absent.
        looks: as for `innovations`.

    Raises:
        SolveError: the model cannot be simulated at the start.
    """
    search = _Search(q, p, plain, guide, iterations, only, looks)
    start = np.clip(p[list(q.free)] / q.typical, search.low, search.high)
    if not np.abs(search.residuals(start)[: -len(start)]).min() < LOST:
        raise SolveError("the simulation leaves the numbers at the start values; check them and their units")
    try:
        found = least_squares(
            search.residuals, start, search.slopes, bounds=(search.low, search.high), loss="huber", f_scale=FAR,
            max_nfev=iterations, ftol=TOLERANCE, xtol=1e-6, gtol=1e-12,
        )  # fmt: skip
        x, loss = found.x, float(found.cost)
    except _Spent:
        x, loss = search.x, search.loss()
    best = p.copy()
    best[list(q.free)] = np.clip(x * q.typical, q.low, q.high)
    return Steered(best, loss)


class _Spent(Exception):
    """No evaluation is left, so that slopes would lead nowhere."""


class _Search:
    """Residuals and slopes by the free parameters in typical sizes; remembers where it was last.

    Slopes cost as many simulations as there are parameters: they need not be taken where no step will follow, nor the
    innovations anew where they are known.
    """

    def __init__(
        self,
        q: Question,
        p: Array,
        plain: Model,
        guide: Filtered,
        evaluations: int,
        only: Sequence[int] | None,
        looks: Booleans | None,
    ) -> None:
        self.q, self.p, self.plain, self.guide, self.left = q, p, plain, guide, evaluations
        self.only, self.looks = only, looks
        self.low, self.high = q.low / q.typical, q.high / q.typical
        self.nudges = np.full(len(q.free), NUDGES[1])
        self.x, self.values = np.full(len(q.free), np.nan), np.zeros(0)

    def residuals(self, x: Array) -> Array:
        """Innovations in sd, then what the priors miss."""
        if not np.array_equal(x, self.x):
            prior = (x * self.q.typical - self.q.prior) / self.q.prior_sd
            self.x, self.values = x.copy(), np.concatenate([self._seen(x[None])[0], prior])
            self.left -= 1
        return self.values

    def slopes(self, x: Array) -> Array:
        """Of the residuals, (residuals, free); raises `_Spent` where the search must end."""
        here = self.residuals(x)[: -len(x)]
        if self.left <= 0:
            raise _Spent
        step = np.where(x + self.nudges > self.high, -self.nudges, self.nudges)
        J = (self._seen(x + np.diag(step)) - here).T / step
        self.nudges = np.clip(REACH / np.maximum(np.linalg.norm(J, axis=0), 1e-12), NUDGES[0], NUDGES[2])
        return np.vstack([J, np.diag(self.q.typical / self.q.prior_sd)])

    def loss(self) -> float:
        """Huber's, where it was last, as SciPy counts it."""
        return 0.5 * float(np.sum(huber(self.values)))

    def _seen(self, X: Array) -> Array:
        P = np.tile(self.p, (len(X), 1))
        P[:, list(self.q.free)] = X * self.q.typical
        return innovations(self.q, P, self.plain, self.guide, self.only, self.looks)
