"""Offline prediction-error ARMAX: the reference for the recursion.

Minimises V = mean of e(t)^2, e = (A y - B u) / C, by Levenberg-Marquardt with the exact gradient
(`optid.armax.gradient`). The criterion has local minima, so several starts are used, and the best result counts. A
long recording is first fitted to excerpts, and then refined on all samples.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from optid.armax.gradient import Problem, residuals_from_openings
from optid.armax.identifiability import OpenDirection, open_directions, rounding
from optid.armax.identifier import Identifier, Method, Settings
from optid.armax.model import Armax
from optid.armax.regression import hannan_rissanen, least_squares
from optid.armax.signals import Signals, check_orders, signals
from optid.armax.stability import roots_inside, stabilise
from optid.armax.structure import Orders
from optid.armax.trend import Frame, Trend
from optid.core.model import Array
from optid.errors import NotIdentifiable

MOST_STEPS = 200
# Relative decrease of V below which a search has converged, and the largest next step relative to the noise (Bates
# and Watts 1981): at the end, on a long recording, and while starts are compared.
AT_LAST, AT_LENGTH, AMONG_STARTS = (1e-10, 1e-3), (1e-9, 1e-2), (1e-7, 1e-2)
STABLE_RADIUS = 0.9999
SEARCHED = 40_000  # samples on which the starts are compared; all of a shorter recording
CHANCE = 10.0  # residual variances by which fixing a direction may increase the sum of squares


class Outcome(enum.Enum):
    """How the search ended, and what to do about it."""

    CONVERGED = "converged"
    STEPS_USED_UP = "it was still improving at the last iteration: use a lower order or a longer recording"
    AT_STABILITY = (
        "the roots of the noise polynomial C lie on the unit circle: lower nc, or remove a trend from "
        "the data"
    )


@dataclass(frozen=True)
class BatchFit:
    """An ARMAX model fitted to whole recordings.

    Attributes:
        model: with covariance noise_variance (Psi' Psi)^-1, infinite where the data leave a direction open.
        outcome: how the search ended.
        loss: mean squared one-step error, output unit squared.
        samples: number of residuals used.
        starts: loss reached from each start, best first, on the excerpts of a long recording; differences between them
            show local minima.
        open: combinations of coefficients that the samples do not determine.
    """

    model: Armax
    outcome: Outcome
    loss: float
    samples: int
    starts: tuple[tuple[str, float], ...]
    open: tuple[OpenDirection, ...]

    @property
    def determined(self) -> bool:
        """Whether the samples determine all combinations of parameters."""
        return not self.open


def residuals_of(model: Armax, y: ArrayLike, u: ArrayLike | None) -> tuple[Array, Array]:
    """e, shape (N,), and its gradient psi = -de/dtheta, shape (N, parameters), zero where a lag is lost.

    A model with a constant has two more columns behind B's: of the constant and of the slope.
    """
    record, o = signals(y, u), model.orders
    theta, full = model.theta, o
    if model.constant or model.slope:
        time = model.sample_time * np.arange(float(record.y.size))
        record = Signals(record.y, np.column_stack([record.u, np.ones_like(time), time]))
        full = Orders(o.na, (*o.nb, 1, 1), o.nc, (*o.nk, 0, 0))
        at = o.parameters - o.nc
        theta = np.concatenate([theta[:at], [model.constant, model.slope], theta[at:]])
    return residuals_from_openings(record, full, theta)


def fit_batch(
    records: Sequence[tuple[ArrayLike, ArrayLike | None] | Signals],
    orders: Orders,
    sample_time: float = 1.0,
    start: ArrayLike | None = None,
    *,
    trend: Trend = Trend.NONE,
    alone: bool = False,
    quick: bool = False,
) -> BatchFit:
    """Fit an ARMAX model to one or several recordings by prediction errors.

    Args:
        records: pairs (y, u) as in `identify`, or `Signals`.
        orders: of eq. 12.
        sample_time: seconds.
        start: theta to start from besides the built-in starts.
        trend: terms added to eq. 12.
        alone: search from `start` alone.
        quick: search from the long regressions alone.

    Raises:
        NotIdentifiable: too few complete samples.
    """
    raw = [r if isinstance(r, Signals) else signals(*r) for r in records]
    check_orders(raw, orders)
    frame = Frame.of(raw, orders, sample_time, trend)
    problem = Problem.of([frame.augmented(r) for r in raw], frame.full_orders)
    given = {} if start is None else {"given": frame.entered(np.asarray(start, dtype=float))}
    searched = _excerpted(problem, frame.full_orders)
    starts = given if alone and given else _starts(searched, quick) | given
    idle = _open_in_data(searched, frame, raw)
    first = AMONG_STARTS if len(starts) > 1 or searched is not problem else AT_LAST
    ends = sorted(
        (
            (name, *_search(searched, _stable(theta, searched.orders), idle, first))
            for name, theta in starts.items()
        ),
        key=lambda end: end[2],
    )
    theta: Array = ends[0][1]
    loss, outcome = ends[0][2:]
    if first is AMONG_STARTS:
        theta, loss, outcome = _search(problem, theta, idle, AT_LAST if searched is problem else AT_LENGTH)
    theta, covariance, found = _uncertainty(problem, frame, raw, theta, loss)
    variance = loss * problem.count / max(problem.count - problem.orders.parameters, 1)
    square = frame.output**2
    return BatchFit(
        frame.model(theta, variance * square, covariance),
        outcome,
        loss * square,
        problem.count,
        tuple((name, value * square) for name, _, value, _ in ends),
        found,
    )


def informed(record: Signals, model: Armax, trend: Trend) -> tuple[Array, tuple[OpenDirection, ...]]:
    """Covariance of a model's coefficients, and the undetermined combinations, as for a fit.

    Args:
        record: on which it was identified.
        model: of any estimator.
        trend: estimated with it.
    """
    frame, problem, theta = placed([record], model, trend)
    _, covariance, found = _uncertainty(problem, frame, [record], theta, problem.loss(theta))
    spread = frame.model(theta, 0.0, covariance).covariance
    return np.array(spread), found


def placed(records: Sequence[Signals], model: Armax, trend: Trend) -> tuple[Frame, Problem, Array]:
    """The coordinates of a fit to these recordings, its problem, and a model in these coordinates, shape (n,)."""
    frame = Frame.of(records, model.orders, model.sample_time, trend)
    problem = Problem.of([frame.augmented(record) for record in records], frame.full_orders)
    M, m = frame.affine()
    at = model.orders.parameters - model.orders.nc
    extra = [model.constant, model.slope][: trend.value]
    values = np.concatenate([model.theta[:at], extra, model.theta[at:]])
    return frame, problem, np.asarray(np.linalg.solve(M, values - m))


def _excerpted(problem: Problem, orders: Orders) -> Problem:
    """The same over excerpts of long recordings, where these still determine something."""
    if problem.count <= SEARCHED:
        return problem
    share = SEARCHED / problem.count
    parts = [part for r in problem.records for part in r.excerpts(max(int(share * r.y.size), 1000))]
    smaller = Problem.of(parts, orders)
    return smaller if smaller.count > 20 * orders.parameters else problem


def _starts(problem: Problem, quick: bool) -> dict[str, Array]:
    """Start vectors of the search, by the method that gave them."""
    records, orders = problem.records, problem.orders
    if orders.nc == 0:
        return {"least squares": least_squares(records, orders)}
    starts = {"least squares": np.concatenate([least_squares(records, orders), np.zeros(orders.nc)])}
    for factor in (2, 5):
        long = factor * max(orders.na, orders.nc, 4)
        try:
            starts[f"long regression {long}"] = hannan_rissanen(records, orders, long)
        except (NotIdentifiable, np.linalg.LinAlgError):
            continue  # too short for this start; the others remain
    if quick and len(starts) > 1:
        return {name: theta for name, theta in starts.items() if name != "least squares"}
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


def _open_in_data(problem: Problem, frame: Frame, raw: Sequence[Signals]) -> Array:
    """Combinations of A, B and trend that do not change the regression, for any C, shape (n, k)."""
    at_rest = np.zeros(problem.orders.parameters)
    R, _, size = equilibrated(problem.information(at_rest))
    own = np.setdiff1d(np.arange(at_rest.size), np.r_[problem.orders.c_block])
    plain = Orders(problem.orders.na, problem.orders.nb, 0, problem.orders.nk)
    floor = _floor(problem, frame, raw, at_rest) / size
    found = open_directions(R[np.ix_(own, own)], plain, frame.orders.inputs, floor[own]).basis
    basis = np.zeros((at_rest.size, found.shape[1]))
    basis[own] = found / size[own, None]
    return basis


def _search(
    problem: Problem, theta: Array, idle: Array, arrived: tuple[float, float]
) -> tuple[Array, float, Outcome]:
    """Levenberg-Marquardt from one start; C stays inside the stable region, and theta off what is `idle`."""
    n, nc, work = theta.size, problem.orders.nc, np.empty(2 * problem.orders.nc)
    if idle.size:
        theta = _shortest(theta, idle, equilibrated(problem.information(theta))[2])
    R, target, size = equilibrated(problem.information(theta))
    loss, damping, edge = problem.loss(theta), 1e-3, False
    for _ in range(MOST_STEPS):
        offset = float(np.linalg.norm(target[:n]) / max(abs(target[n]), 1e-300))
        if offset < arrived[1] * np.sqrt(n / problem.count):
            return theta, loss, Outcome.CONVERGED
        while True:
            closed = _closed(R, idle, size)
            stacked = np.concatenate([closed, np.sqrt(damping) * np.eye(n)])
            wanted = np.concatenate([target[:n], np.zeros(n)])
            trial = theta + np.linalg.lstsq(stacked, wanted, rcond=None)[0] / size
            edge = not roots_inside(trial[problem.orders.c_block], nc, STABLE_RADIUS, work)
            new = np.inf if edge else problem.loss(trial)
            if new <= loss:
                break
            damping *= 4.0
            if damping > 1e12:
                return theta, loss, Outcome.AT_STABILITY if edge else Outcome.CONVERGED
        gain = (loss - new) / loss if loss > 0.0 else 0.0
        theta, loss = trial, new
        if gain < arrived[0] and damping <= 1e-3:
            return theta, loss, Outcome.CONVERGED
        R, target, size = equilibrated(problem.information(theta))
        damping = max(damping / 10.0, 1e-15)
    return theta, loss, Outcome.STEPS_USED_UP


def _shortest(theta: Array, idle: Array, size: Array) -> Array:
    """Theta without its share in the idle directions, lengths being those of equilibrated columns."""
    if not idle.size:
        return theta
    Q, _ = np.linalg.qr(idle * size[:, None])
    out: Array = theta - (Q @ (Q.T @ (theta * size))) / size
    return out


def _closed(R: Array, idle: Array, size: Array) -> Array:
    """R without the idle directions, so that the shortest step does not change them."""
    if not idle.size:
        return R
    Q, _ = np.linalg.qr(idle * size[:, None])
    out: Array = R - (R @ Q) @ Q.T
    return out


def equilibrated(both: Array) -> tuple[Array, Array, Array]:
    """R of Psi with columns of unit size, Q' e with the norm of the unexplained part, and the sizes."""
    n = both.shape[1] - 1
    size: Array = np.sqrt(np.sum(both[:, :n] ** 2, axis=0))
    size[size == 0.0] = 1.0
    return both[:n, :n] / size, both[:, n], size


def _uncertainty(
    problem: Problem, frame: Frame, raw: Sequence[Signals], theta: Array, loss: float
) -> tuple[Array, Array, tuple[OpenDirection, ...]]:
    """Theta without undetermined parts, where that does not raise the loss; the covariance; the combinations."""
    orders = problem.orders
    R, _, size = equilibrated(problem.information(theta))
    floor = _floor(problem, frame, raw, theta) / size
    directions = open_directions(R, orders, frame.orders.inputs, floor)
    basis = directions.basis
    if basis.size:
        shortest = theta - (basis @ (basis.T @ (theta * size))) / size
        stable = roots_inside(shortest[orders.c_block], orders.nc, STABLE_RADIUS, np.empty(2 * orders.nc))
        if stable and problem.loss(shortest) <= (1.0 + CHANCE * basis.shape[1] / problem.count) * loss:
            theta = shortest
    closed = R - (R @ basis) @ basis.T
    _, singular, Vt = np.linalg.svd(closed)
    kept = singular > 1e-13 * max(float(singular[0]), 1e-300)
    kept[len(singular) - basis.shape[1] :] = False
    told = Vt.T[:, kept] / singular[kept]
    variance = loss * problem.count / max(problem.count - orders.parameters, 1)
    covariance = variance * (told @ told.T) / np.outer(size, size)
    touched = directions.touched
    covariance[np.ix_(touched, touched)] = np.nan
    covariance[touched, touched] = np.inf
    return theta, covariance, directions.named


def _floor(problem: Problem, frame: Frame, raw: Sequence[Signals], theta: Array) -> Array:
    """Norm of the contribution of rounding to each column of Psi, shape (n,)."""
    from scipy.signal import lfilter

    orders = problem.orders
    pulse = np.zeros(2000)
    pulse[0] = 1.0
    c = np.concatenate([[1.0], theta[orders.c_block]])
    passed = float(np.sqrt(np.sum(lfilter([1.0], c, pulse) ** 2) * problem.count / 12.0))
    floor = np.zeros(orders.parameters)
    floor[: orders.na] = max(rounding(r.y) for r in raw) / frame.output
    for i, block in enumerate(list(orders.blocks())[: frame.orders.inputs]):
        floor[block] = max(rounding(r.u[:, i]) for r in raw) / frame.inputs[i]
    return floor * passed
