"""Models fitted for a horizon: the k-step prediction error itself is minimised.

The error of predicting y(t) from t - k is e(t) + f_1 e(t-1) + .. + f_{k-1} e(t-k+1), f being the first k samples of
C/A (Ljung, System Identification, 2nd ed. 1999, sec. 3.2). A correct model has the same coefficients at every horizon;
an incomplete one trades the error of the next sample for later ones.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from optid.armax.gradient import Problem, residuals_and_gradient
from optid.armax.model import Armax
from optid.armax.regression import column_sizes, triangle
from optid.armax.signals import Mask, Signals
from optid.armax.stability import roots_inside
from optid.armax.structure import Orders
from optid.armax.trend import Frame, Trend
from optid.core.model import Array
from optid.errors import InputError

SEARCHED = 20_000  # samples
MOST_STEPS = 40
SMALLEST_GAIN = 1e-7
STABLE_RADIUS = 0.9999


def noise_response(a: Array, c: Array, steps: int) -> Array:
    """The first samples of C/A, shape (steps,)."""
    from scipy.signal import lfilter

    pulse = np.zeros(steps)
    pulse[0] = 1.0
    return np.asarray(lfilter(c, a, pulse))


def expected_error(model: Armax, steps: int) -> float:
    """Standard deviation that A, C and the noise variance predict for the k-step error, output's unit."""
    response = noise_response(np.array(model.a), np.array(model.c), steps)
    with np.errstate(over="ignore"):
        return float(np.sqrt(model.noise_variance * np.sum(response**2)))


def fit_for_horizon(records: Sequence[Signals], start: Armax, steps: int, trend: Trend = Trend.NONE) -> Armax:
    """The model of the same structure with the smallest k-step error, started from one fitted to one step.

    Args:
        records: to fit to; of long ones excerpts.
        start: orders, sample time and where to begin.
        steps: k.
        trend: terms added to eq. 12.

    Returns:
        the model, without covariance; its noise variance is the one-step error's.
    """
    if steps < 1:
        raise InputError(f"{steps}", field="steps", expected="a whole number of at least 1")
    parts = [part for r in records for part in r.excerpts(max(SEARCHED // len(records), 1000))]
    frame = Frame.of(parts, start.orders, start.sample_time, trend)
    problem = Problem.of([frame.augmented(r) for r in parts], frame.full_orders)
    M, m = frame.affine()
    at, own = start.orders.parameters - start.orders.nc, [start.constant, start.slope][: trend.value]
    begin = np.linalg.solve(M, np.concatenate([start.theta[:at], own, start.theta[at:]]) - m)
    theta = _search(problem, np.asarray(begin, dtype=float), steps)
    return frame.model(theta, problem.loss(theta) * frame.output**2)


def _search(problem: Problem, theta: Array, steps: int) -> Array:
    """Levenberg-Marquardt on the sum of squared k-step errors."""
    n, orders, damping = theta.size, problem.orders, 1e-3
    error, J = _errors(problem, theta, steps)
    loss = float(np.mean(error**2))
    for _ in range(MOST_STEPS):
        size = column_sizes(J)
        both = triangle(np.column_stack([J / size, error]))
        while True:
            stacked = np.concatenate([both[:n, :n], np.sqrt(damping) * np.eye(n)])
            wanted = np.concatenate([both[:n, n], np.zeros(n)])
            trial = theta - np.linalg.lstsq(stacked, wanted, rcond=None)[0] / size
            work, new = np.empty(2 * orders.nc), np.inf
            if roots_inside(trial[orders.c_block], orders.nc, STABLE_RADIUS, work):
                with np.errstate(all="ignore"):
                    error_new, J_new = _errors(problem, trial, steps)
                    new = float(np.mean(error_new**2))
            if new <= loss:
                break
            damping *= 5.0
            if damping > 1e10:
                return theta
        arrived = loss - new < SMALLEST_GAIN * loss
        theta, loss, error, J = trial, new, error_new, J_new
        if arrived:
            return theta
        damping = max(damping / 10.0, 1e-12)
    return theta


def _errors(problem: Problem, theta: Array, steps: int) -> tuple[Array, Array]:
    """k-step errors of all records and their slopes to theta, shapes (N,) and (N, n)."""
    es, Js = [], []
    for record, keep in zip(problem.records, problem.keeps, strict=True):
        e, Psi = residuals_and_gradient(record, keep, problem.orders, theta)
        error, J = _accumulated(e, Psi, problem.orders, theta, steps)
        known = _all_known(keep, steps)
        es.append(error[known])
        Js.append(J[known])
    return np.concatenate(es), np.concatenate(Js)


def _accumulated(e: Array, Psi: Array, orders: Orders, theta: Array, steps: int) -> tuple[Array, Array]:
    from scipy.signal import lfilter

    a, c = np.r_[1.0, theta[: orders.na]], np.r_[1.0, theta[orders.c_block]]
    f = noise_response(a, c, steps)
    J = -np.asarray(lfilter(f, [1.0], Psi, axis=0))
    by_a = -noise_response(np.convolve(a, a), c, steps)  # slope of C/A to a_i, i samples later
    by_c = noise_response(a, np.ones(1), steps)
    for i in range(1, min(orders.na, steps - 1) + 1):
        J[:, i - 1] += lfilter(np.r_[np.zeros(i), by_a[: steps - i]], [1.0], e)
    for i in range(1, min(orders.nc, steps - 1) + 1):
        J[:, theta.size - orders.nc + i - 1] += lfilter(np.r_[np.zeros(i), by_c[: steps - i]], [1.0], e)
    return np.asarray(lfilter(f, [1.0], e)), J


def _all_known(keep: Mask, steps: int) -> Mask:
    """Where this sample's residual and the k - 1 before it are known."""
    count = np.cumsum(np.r_[0, keep.astype(int)])
    known = np.zeros(keep.size, dtype=bool)
    known[steps - 1 :] = count[steps:] - count[:-steps] == steps
    return known
