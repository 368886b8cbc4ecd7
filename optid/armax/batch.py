"""Batch prediction-error ARMAX: the reference for the recursion.

Minimises V = mean of e(t)^2, e = (A y - B u) / C, by Levenberg-Marquardt with the exact gradient
psi(t) = -de(t)/dtheta = phi(t) / C(q) (Ljung, System Identification, 2nd ed. 1999, sec. 10.3). The
criterion has false minima, in which a search from one start may end; so several starts run, the best counts.
After a gap the residuals start again from zero.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from optid.armax.identifier import Identifier, Method, Settings
from optid.armax.model import Armax, from_theta
from optid.armax.regression import column_sizes, hannan_rissanen, least_squares, triangle
from optid.armax.signals import Mask, Signals, check_orders, signals, usable
from optid.armax.stability import roots_inside, stabilise
from optid.armax.structure import Orders
from optid.core.compiling import kept
from optid.core.model import Array
from optid.errors import NotIdentifiable

MOST_STEPS = 200
SMALLEST_GAIN = 1e-10  # relative decrease of V below which the search has arrived
ARRIVED = 1e-3  # of what the noise leaves open: a next step so small has arrived (Bates and Watts 1981)
OPEN = 1e-9  # share of the largest singular value of Psi below which a direction counts as left open
STABLE_RADIUS = 0.9999


class Outcome(enum.Enum):
    """How the search ended, and what to do about it."""

    CONVERGED = "converged"
    STEPS_USED_UP = "still improving after the last step: fewer orders or a longer recording would settle it"
    AT_STABILITY = (
        "the noise polynomial C lies at the edge of stability: lower nc, or take a trend out of the data"
    )


@dataclass(frozen=True)
class BatchFit:
    """An ARMAX model fitted to whole recordings.

    Attributes:
        model: with covariance noise_variance (Psi' Psi)^-1.
        outcome: how the search ended.
        loss: mean squared one-step error, output unit squared.
        samples: residuals that count.
        starts: loss reached from each start, best first; starts that differ say how rugged the criterion is.
        determined: false where the samples leave a combination of parameters open.
    """

    model: Armax
    outcome: Outcome
    loss: float
    samples: int
    starts: tuple[tuple[str, float], ...]
    determined: bool


@kept(error_model="numpy", nogil=True)
def _residuals(y, u, keep, theta, na, nbs, nks, nc, e, Psi):  # type: ignore[no-untyped-def]
    """Fill e (N,) and psi (N, n) of one record; both are zero where `keep` is false."""
    n = theta.size
    phi = np.empty(n)
    for t in range(y.size):
        if not keep[t]:
            e[t] = 0.0
            Psi[t, :] = 0.0
            continue
        for k in range(na):
            phi[k] = -y[t - 1 - k]
        column = na
        for i in range(nbs.size):
            for k in range(nbs[i]):
                phi[column] = u[t - nks[i] - k, i]
                column += 1
        for k in range(nc):
            phi[column + k] = e[t - 1 - k] if t > k else 0.0
        guess = 0.0
        for k in range(n):
            guess += phi[k] * theta[k]
            Psi[t, k] = phi[k]
        e[t] = y[t] - guess
        for k in range(min(nc, t)):
            share = theta[n - nc + k]
            for j in range(n):
                Psi[t, j] -= share * Psi[t - 1 - k, j]


def residuals_of(model: Armax, y: ArrayLike, u: ArrayLike | None) -> tuple[Array, Array]:
    """e, shape (N,), and its gradient psi = -de/dtheta, shape (N, parameters), zero where a lag is lost."""
    record, o = signals(y, u), model.orders
    e, Psi = np.empty(record.y.size), np.empty((record.y.size, o.parameters))
    nbs, nks = np.array(o.nb, dtype=np.int64), np.array(o.nk, dtype=np.int64)
    _residuals(record.y, record.u, usable(record, o), model.theta, o.na, nbs, nks, o.nc, e, Psi)
    return e, Psi


@dataclass(frozen=True)
class _Problem:
    records: tuple[Signals, ...]
    keeps: tuple[Mask, ...]
    orders: Orders
    count: int

    def residuals(self, theta: Array) -> tuple[Array, Array]:
        """e and psi over all records, shapes (N,) and (N, n)."""
        o = self.orders
        nbs, nks = np.array(o.nb, dtype=np.int64), np.array(o.nk, dtype=np.int64)
        es, Psis = [], []
        for record, keep in zip(self.records, self.keeps, strict=True):
            e, Psi = np.empty(record.y.size), np.empty((record.y.size, o.parameters))
            _residuals(record.y, record.u, keep, theta, o.na, nbs, nks, o.nc, e, Psi)
            es.append(e[keep])
            Psis.append(Psi[keep])
        return np.concatenate(es), np.concatenate(Psis)

    def loss(self, e: Array) -> float:
        return float(np.sum(e**2)) / self.count


def fit_batch(
    records: Sequence[tuple[ArrayLike, ArrayLike | None]],
    orders: Orders,
    sample_time: float = 1.0,
    start: ArrayLike | None = None,
) -> BatchFit:
    """Fit an ARMAX model to one or several recordings by prediction errors.

    Args:
        records: pairs (y, u) as in `identify`.
        orders: of eq. 12.
        sample_time: seconds.
        start: theta to start from besides the built-in starts.

    Raises:
        NotIdentifiable: too few complete samples.
    """
    raw = [signals(y, u) for y, u in records]
    check_orders(raw, orders)
    scales = [record.scales for record in raw]
    sy = max(s[0] for s in scales)
    su = np.max([s[1] for s in scales], axis=0)
    scaled = tuple(Signals(r.y / sy, np.ascontiguousarray(r.u / su)) for r in raw)
    keeps = tuple(usable(record, orders) for record in scaled)
    problem = _Problem(scaled, keeps, orders, int(sum(keep.sum() for keep in keeps)))
    factors = np.ones(orders.parameters)
    for i, block in enumerate(orders.blocks()):
        factors[block] = sy / su[i]
    starts = _starts(problem)
    if start is not None:
        starts["given"] = np.asarray(start, dtype=float) / factors
    ends = sorted(
        ((name, *_search(problem, _stable(theta, orders))) for name, theta in starts.items()),
        key=lambda end: end[2],
    )
    _, theta, loss, outcome = ends[0]
    e, Psi = problem.residuals(theta)
    variance = problem.loss(e) * problem.count / (problem.count - orders.parameters)
    size = column_sizes(Psi)
    _, singular, Vt = np.linalg.svd(triangle(Psi / size))
    determined = bool(singular[-1] > OPEN * singular[0])
    told = Vt.T[:, singular > OPEN * singular[0]] / singular[singular > OPEN * singular[0]]
    inverse = told @ told.T / np.outer(size, size)
    model = from_theta(
        theta * factors,
        orders,
        sample_time,
        variance * sy**2,
        variance * inverse * np.outer(factors, factors),
    )
    return BatchFit(
        model,
        outcome,
        loss * sy**2,
        problem.count,
        tuple((name, value * sy**2) for name, _, value, _ in ends),
        determined,
    )


def _starts(problem: _Problem) -> dict[str, Array]:
    """Parameter vectors to search from: names say how they were found."""
    records, orders = problem.records, problem.orders
    if orders.nc == 0:
        return {"least squares": least_squares(records, orders)}
    starts = {"least squares": np.concatenate([least_squares(records, orders), np.zeros(orders.nc)])}
    for factor in (2, 5):
        long = factor * max(orders.na, orders.nc, 4)
        try:
            starts[f"long regression {long}"] = hannan_rissanen(records, orders, long)
        except (NotIdentifiable, np.linalg.LinAlgError):
            continue  # too short for this one; the others remain
    settings = Settings(method=Method.EXTENDED_LEAST_SQUARES)
    identifier = Identifier(orders, settings=settings)
    for record in records:
        identifier.run(record.y, record.u)
        identifier.run([np.nan], np.full((1, orders.inputs), np.nan))  # the next record is another start
    starts["recursion"] = identifier.theta
    return {name: theta for name, theta in starts.items() if np.all(np.isfinite(theta))}


def _stable(theta: Array, orders: Orders) -> Array:
    theta = theta.copy()
    stabilise(theta[orders.c_block], orders.nc, 0.98, np.empty(2 * orders.nc))
    return theta


def _search(problem: _Problem, theta: Array) -> tuple[Array, float, Outcome]:
    """Levenberg-Marquardt from one start; C stays inside the stable region."""
    n, nc, work = theta.size, problem.orders.nc, np.empty(2 * problem.orders.nc)
    e, Psi = problem.residuals(theta)
    loss, damping = problem.loss(e), 1e-3
    edge = False
    for _ in range(MOST_STEPS):
        R, target, size = _triangle(Psi, e)
        offset = float(np.linalg.norm(target[:n]) / max(abs(target[n]), 1e-300))
        if offset < ARRIVED * np.sqrt(n / problem.count):
            return theta, loss, Outcome.CONVERGED
        while True:
            stacked = np.concatenate([R, np.sqrt(damping) * np.eye(n)])
            wanted = np.concatenate([target[:n], np.zeros(n)])
            trial = theta + np.linalg.lstsq(stacked, wanted, rcond=None)[0] / size
            edge = not roots_inside(trial[problem.orders.c_block], nc, STABLE_RADIUS, work)
            new = np.inf
            if not edge:
                e_new, Psi_new = problem.residuals(trial)
                new = problem.loss(e_new)
            if new <= loss:
                break
            damping *= 4.0
            if damping > 1e12:
                return theta, loss, Outcome.AT_STABILITY if edge else Outcome.CONVERGED
        gain = (loss - new) / loss if loss > 0.0 else 0.0
        theta, e, Psi, loss = trial, e_new, Psi_new, new
        if gain < SMALLEST_GAIN and damping <= 1e-3:
            return theta, loss, Outcome.CONVERGED
        damping = max(damping / 10.0, 1e-15)
    return theta, loss, Outcome.STEPS_USED_UP


def _triangle(Psi: Array, e: Array) -> tuple[Array, Array, Array]:
    """R of Psi with columns of unit size, Q' e with the length of what Psi cannot explain, and the sizes."""
    size, n = column_sizes(Psi), Psi.shape[1]
    both = triangle(np.column_stack([Psi / size, e]))
    return both[:n, :n], both[:, n], size
