"""Covariance of fitted parameters that stays valid for coloured residuals.

Near the optimum theta moves by the sum over samples of (influence x residual). The influence follows from the
factored normal equations, with all node states eliminated. Two estimates of that sum's variance are made:

- *stationary*: residuals as an autoregression (order by AIC, Yule-Walker), its spectrum against the influences';
- *blocks*: products of the contributions themselves over neighbouring windows (Newey and West 1987 with
  Bartlett weights), which needs no stationarity: a mismatch in a few windows is weighted by the influence there.

The first one has much less scatter. The second one is used for a parameter if it is larger than its own scatter allows
at the 5 % level; then Student's t replaces the normal distribution.
"""

from __future__ import annotations

import itertools

import numpy as np
from scipy import special
from scipy.fft import next_fast_len, rfft

from optid.core.jit import compiled
from optid.core.kernel import trace
from optid.core.model import Array
from optid.core.threads import parallel_for
from optid.estimation.problem import Problem
from optid.estimation.result import CONFIDENCE, Z95
from optid.estimation.smoother import Objective, Point, System, Terms, settled_system, solve_schur


def covariance(o: Objective, at: Point, t: Terms, q: Array, held: np.ndarray) -> Array:
    """Covariance of the free parameters, (free, free), SI, for normal quantiles; zero for the `held` ones."""
    s = settled_system(o, at, t, q, held)
    schur = s.schur + np.diag(held.astype(float))
    s = type(s)(s.factor, s.Z, schur, s.rhs_x, s.rhs_theta, s.step_x)
    influence, residual = _influence(o, at, s, held)
    contributions = np.zeros((len(o.problem.begins), len(o.free)))
    stationary = np.zeros((len(o.free), len(o.free)))
    for j in range(residual.shape[1]):
        known = np.isfinite(residual[:, j])
        if not known.any():
            continue
        a = np.where(known[:, None], influence[:, j, :], 0.0)
        r = np.where(known, residual[:, j], 0.0)
        contributions += np.add.reduceat(a * r[:, None], o.problem.begins)
        stationary += _stationary(a, r, known, o.problem)
    jumps = _defect_influence(o, t, s, q, held)
    contributions += jumps
    stationary += jumps.T @ jumps
    blocks, freedom = _newey_west(contributions, o.problem)
    prior = solve_schur(s, np.diag((o.typical * ~held / o.prior_sd) ** 2))
    prior = solve_schur(s, prior.T)  # contribution of the prior: S^-1 (1/sd^2) S^-1
    # With the level of the intervals the blocks' variance is used although the stationary one is right.
    more = np.diag(blocks) > special.chdtri(freedom, 1.0 - CONFIDENCE) / freedom * np.diag(stationary)
    wider = (special.stdtrit(freedom, (1.0 + CONFIDENCE) / 2.0) / Z95) ** 2
    sd = np.sqrt(np.where(more, wider * np.diag(blocks), np.diag(stationary)))
    correlation = stationary / np.maximum(np.sqrt(np.outer(np.diag(stationary), np.diag(stationary))), 1e-300)
    total = correlation * np.outer(sd, sd) + prior
    scale = o.typical * ~held
    return np.asarray(total * np.outer(scale, scale))


def _influence(o: Objective, at: Point, s: System, held: np.ndarray) -> tuple[Array, Array]:
    """d theta / d (residual in sd): (samples, outputs, free); and the residuals."""
    b, nx = o.problem, len(o.model.states)
    machine, n, ny = compiled(o.model, o.free), len(b.time), len(o.model.outputs)
    X, Y, G = np.full((n, nx), np.nan), np.full((n, ny), np.nan), np.zeros((n, ny, machine.width))
    sizes = o.tolerance * o.model.scales
    arguments = (b.begins, b.counts, b.closed, at.X, at.p, b.dt, b.inputs, sizes, X, Y, G)
    parallel_for(len(b.begins), lambda i, j: machine.run(trace, i, j, *arguments))
    # From slopes along a window's start and along theta to those along theta with the states eliminated, in one.
    eliminated = -o.model.scales[:, None] * s.Z.reshape(len(b.begins), nx, -1)
    along = np.broadcast_to(np.diag(o.typical * ~held), (len(b.begins), len(o.free), len(o.free)))
    onto = np.concatenate([eliminated, along], axis=1) @ solve_schur(s, np.eye(len(o.free)))
    influence = np.empty((n, ny, len(o.free)))
    for w, (i, j) in enumerate(itertools.pairwise([*b.begins, n])):
        influence[i:j] = G[i:j, :, : machine.directions] @ onto[w]
    residual = (b.measured - Y) * o.weight
    factor = np.minimum(1.0, o.huber / np.maximum(np.abs(residual), 1e-300))
    return influence * o.weight[:, :, None], residual * factor


def _defect_influence(o: Objective, t: Terms, s: System, q: Array, held: np.ndarray) -> Array:
    """Influence of each node's defect on theta, (windows, free)."""
    nx, D = len(o.model.states), o.model.scales
    Z = s.Z.reshape(len(t.end), nx, -1)
    F = t.slope[:, :, :nx] * D
    following = np.vstack([Z[1:], np.zeros((1, *Z.shape[1:]))])
    towards = -t.slope[:, :, nx:] * (o.typical * ~held) + np.einsum("wij,wjf->wif", F, Z)
    towards -= D[:, None] * following
    pull = np.einsum("wif,wi->wf", towards, -t.defect / q**2) * o.problem.linked[:, None]
    return np.asarray(solve_schur(s, pull.T).T)


def _stationary(a: Array, r: Array, known: np.ndarray, b: Problem) -> Array:
    """Variance of sum(a r) with the residuals' spectrum from an autoregression; segments are independent."""
    edges = np.r_[0, b.begins[1:][b.closed[:-1]], len(r)]
    total = np.zeros((a.shape[1], a.shape[1]))
    pairs = list(itertools.pairwise(edges))
    coefficients, variance = autoregression([r[i:j] for i, j in pairs], int(known.sum()))
    for i, j in pairs:
        size = next_fast_len(2 * (j - i), real=True)
        A = rfft(a[i:j], size, axis=0)
        spectrum = variance / np.abs(rfft(np.r_[1.0, -coefficients], size)) ** 2
        twice = np.full(len(A), 2.0)
        twice[0] = 1.0
        twice[-1] = 1.0 + size % 2
        total += np.real((A * (twice * spectrum)[:, None]).T @ A.conj()) / size
    return total


def autoregression(pieces: list[Array], known: int) -> tuple[Array, float]:
    """Coefficients and innovation variance of an autoregression, its order chosen by AIC (Levinson's recursion)."""
    # The largest order as usual for a series of this length (Schwert, J. Bus. Econ. Statist. 7, 1989).
    order = min(int(10.0 * np.log10(max(known, 10))), max(1, min(len(p) for p in pieces) // 4))
    lags = np.array([sum(float(p[k:] @ p[: len(p) - k]) for p in pieces) for k in range(order + 1)])
    lags /= max(known, 1)
    coefficients, variance = np.zeros(0), float(lags[0])
    best = (known * np.log(max(variance, 1e-300)), coefficients, variance)
    for m in range(1, order + 1):
        if variance <= 0:
            break
        reflection = (lags[m] - coefficients @ lags[m - 1 : 0 : -1]) / variance
        coefficients = np.r_[coefficients - reflection * coefficients[::-1], reflection]
        variance *= 1.0 - reflection**2
        score = known * np.log(max(variance, 1e-300)) + 2 * m
        if score < best[0]:
            best = (score, coefficients, variance)
    return best[1], best[2]


def _newey_west(contributions: Array, b: Problem) -> tuple[Array, float]:
    """Sum of products over windows and their neighbours within a segment, Bartlett weights; degrees of freedom."""
    windows = len(contributions)
    segment = np.cumsum(np.r_[0, b.closed[:-1]])
    reach = max(1, int(4 * (windows / 100) ** (2 / 9)))
    total = contributions.T @ contributions
    for lag in range(1, min(reach, windows - 1) + 1):
        same = (segment[lag:] == segment[:-lag])[:, None]
        cross = (contributions[lag:] * same).T @ contributions[:-lag]
        total += (1 - lag / (reach + 1)) * (cross + cross.T)
    freedom = max(1.5 * windows / (reach + 1), 2.0)  # of Bartlett's weights
    return np.asarray(total * windows / max(windows - 1, 1)), freedom
