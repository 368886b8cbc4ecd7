"""Parameters by prediction error under held gains: a search that costs a fraction of one on the filter's likelihood.

Each model follows the recordings by the gains of a filter that has run already, on a plainer model or at other
parameters, instead of by a filter of its own. Estimates by such innovations are consistent at any gains (Ljung, System
Identification, 1999, section 8.4); the likelihood then takes them as a start.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from optid.core.model import Array, Model
from optid.errors import SolveError
from optid.fit.likelihood import FAR, Filtered, run_steered
from optid.fit.place import NUDGES, REACH, Question

TOLERANCE = 1e-3  # of the loss, that a step must gain for the search to go on
LOST = 1e3  # sd: an innovation of a model that has left the numbers


class Steered(NamedTuple):
    """Where a search under held gains ended: the whole parameter vector, and Huber's loss of the innovations there."""

    p: Array
    loss: float


def innovations(q: Question, P: Array, plain: Model, guide: Filtered) -> Array:
    """Innovations of parameter sets under held gains, in sd of the guide's, (sets, measured).

    Args:
        q: the question.
        P: (sets, parameters).
        plain: model of the guide, whose states are among the question's.
        guide: whose gains and variances hold, with gains kept.
    """
    names = [state.name for state in q.model.states]
    known = np.isfinite(guide.innovations[0])
    E = run_steered(q.model, q.problem, P, guide, [names.index(state.name) for state in plain.states])
    scaled = E[:, known] / np.sqrt(guide.variances[0][known])
    return np.asarray(np.nan_to_num(scaled, nan=LOST, posinf=LOST, neginf=-LOST))


def steered_fit(q: Question, p: Array, plain: Model, guide: Filtered, iterations: int) -> Steered:
    """The parameters under which innovations are least, from a start.

    Args:
        q: the question.
        p: start, (parameters,).
        plain: model of the guide, whose states are among the question's.
        guide: whose gains and variances hold, with gains kept.
        iterations: evaluations at most.

    Raises:
        SolveError: the model cannot be simulated at the start.
    """
    free = list(q.free)
    low, high = q.low / q.typical, q.high / q.typical
    nudges = np.full(len(free), NUDGES[1])

    def seen(X: Array) -> Array:
        P = np.tile(p, (len(X), 1))
        P[:, free] = X * q.typical
        return innovations(q, P, plain, guide)

    def residuals(x: Array) -> Array:
        prior = (x * q.typical - q.prior) / q.prior_sd
        return np.concatenate([seen(x[None])[0], prior])

    def slopes(x: Array) -> Array:
        step = np.where(x + nudges > high, -nudges, nudges)
        here, *others = seen(np.vstack([x, x + np.diag(step)]))
        J = (np.array(others) - here).T / step
        nudges[:] = np.clip(REACH / np.maximum(np.linalg.norm(J, axis=0), 1e-12), NUDGES[0], NUDGES[2])
        return np.vstack([J, np.diag(q.typical / q.prior_sd)])

    start = np.clip(p[free] / q.typical, low, high)
    if not np.abs(residuals(start)[: -len(free)]).min() < LOST:
        raise SolveError("the simulation leaves the numbers at the start values; check them and their units")
    found = least_squares(
        residuals, start, slopes, bounds=(low, high), loss="huber", f_scale=FAR, max_nfev=iterations,
        ftol=TOLERANCE, xtol=1e-6, gtol=1e-12,
    )  # fmt: skip
    best = p.copy()
    best[free] = np.clip(found.x * q.typical, q.low, q.high)
    return Steered(best, float(found.cost))
