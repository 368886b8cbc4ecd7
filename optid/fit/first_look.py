"""A first look at where recordings begin: what no sensor sees there is tried in many places at once.

A record says little of its first state before it moves. Pressures that may lie anywhere between exhaust and supply may
push the piston either way or not at all, and a filter that takes so much for one normal distribution believes, when
the first motion is over, in pressures a tenth of a bar off, and is sure of them. Each of many normal
distributions that together make up the same prior is narrow enough to be filtered well (Gaussian sums: Sorenson and
Alspach, Automatica 7, 1971); the likeliest one, by the first moments of the record, is where the filter begins.

Most records begin at rest. A filter to which the speed is unknown takes friction that holds the axis for forces in
balance, and believes in pressures that would balance: so everything is tried at rest as well.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
from scipy import stats

from optid.core.model import Array, Model
from optid.fit.likelihood import QUIET, Noise, Start, deviance, run_filter, start_of
from optid.fit.problem import Booleans, Problem

PARTS = 32
NARROW = 0.5  # sd of a part, in those of the whole
WORTH = 2.0 * np.log(PARTS)  # in -2 log likelihood: what the likeliest of so many gains by chance


def first_look(model: Model, problem: Problem, p: Array, noise: Noise, seconds: float) -> Start:
    """What is known where each segment begins, after a look at its first `seconds`.

    Args:
        model: the plant.
        problem: posed with one window per segment.
        p: parameters, (parameters,).
        noise: of measurement and states.
        seconds: of every segment that count.

    Returns:
        One of the parts of what the model itself says of the start, moving or at rest, or all that where no part is
        likelier; one set.
    """
    whole = start_of(model, p[None], len(problem.begins))
    measured = np.asarray(np.isfinite(problem.measured).any(axis=0))
    hidden = _unseen(model, p, measured) & (whole.sd[0] > 0.0).all(axis=0)
    if not hidden.any():
        return whole
    z = np.zeros((PARTS, len(model.states)))
    z[:, hidden] = _spread(int(hidden.sum()))
    tried, odds = [_parts(whole, z, hidden)], [_odds(z)]
    if (speeds := _speeds(model, p)).any():
        still, held = np.where(speeds, QUIET * model.scales, whole.sd), np.where(speeds, 0.0, z)
        tried.append(_parts(Start(np.where(speeds, 0.0, whole.mean), still), held, hidden & ~speeds))
        odds.append(_odds(held))
    both = Start(*(np.ascontiguousarray(np.concatenate(a)) for a in zip(*tried, strict=True)))
    counts = np.minimum(
        problem.counts,
        [np.searchsorted(problem.time[b : b + n + 1], problem.time[b] + seconds) - 1
         for b, n in zip(problem.begins, problem.counts, strict=True)],
    )  # fmt: skip
    counts = np.maximum(counts, 1).astype(np.int64)
    rows = np.concatenate([np.arange(b, b + n + 1) for b, n in zip(problem.begins, counts, strict=True)])
    begins = np.r_[0, np.cumsum(counts + 1)[:-1]].astype(np.int64)
    opening = replace(
        problem, time=problem.time[rows], dt=problem.dt[rows], inputs=problem.inputs[rows],
        measured=problem.measured[rows], begins=begins, counts=counts,
    )  # fmt: skip
    count = len(both.mean)
    Q, R = np.tile(noise.spectrum(len(model.states)), (count, 1)), np.tile(noise.measurement, (count, 1))
    f = run_filter(model, opening, np.tile(p, (count, 1)), Q, R, start=both)
    each = deviance(f.innovations, f.variances)
    best = np.zeros(len(problem.begins), dtype=int)
    for k, (begin, n) in enumerate(zip(opening.begins, opening.counts, strict=True)):
        score = each[:, begin : begin + n + 1].sum(axis=1) + np.concatenate(odds)
        best[k] = int(np.argmin(np.where(np.isfinite(score), score, np.inf)))
    segments = np.arange(len(best))
    return Start(both.mean[best, segments][None], both.sd[best, segments][None])


def _parts(whole: Start, z: Array, hidden: Booleans) -> Start:
    """The whole, and its parts at so many sd, narrow in the states that are hidden, (1 + parts, segments, states)."""
    return Start(
        np.concatenate([whole.mean, whole.mean + np.sqrt(1.0 - NARROW**2) * z[:, None] * whole.sd]),
        np.concatenate([whole.sd, np.tile(np.where(hidden, NARROW, 1.0) * whole.sd, (len(z), 1, 1))]),
    )


def _odds(z: Array) -> Array:
    """What speaks against each of such parts beforehand, in -2 log likelihood; for the whole, what chance gains."""
    return np.asarray(np.r_[-WORTH, (z**2).sum(axis=1)])


def _speeds(model: Model, p: Array) -> Booleans:
    """States that are the rate of another, (states,)."""
    x = ca.SX.sym("x", len(model.states))
    rates = model.rates(x, ca.SX.sym("u", len(model.inputs)), ca.DM(p))
    return np.array(
        [any(ca.is_equal(rates[i], x[j]) for i in range(x.numel()) if i != j) for j in range(x.numel())]
    )


def _unseen(model: Model, p: Array, measured: Booleans) -> Booleans:
    """States that no measured output shows at once, (states,)."""
    x = ca.SX.sym("x", len(model.states))
    y = model.sensors(x, ca.SX.sym("u", len(model.inputs)), ca.DM(p))[np.flatnonzero(measured).tolist()]
    return np.array([not ca.depends_on(y, x[i]) for i in range(len(model.states))])


def _spread(states: int) -> Array:
    """Standard normal points, (PARTS, states), evenly spread."""
    points = stats.qmc.Sobol(states, scramble=False).random(PARTS)
    return np.asarray(stats.norm.ppf((points + 0.5 / PARTS) % 1.0))
