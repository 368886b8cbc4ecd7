"""The residuals' autoregression, and intervals that are those of least squares where residuals are white."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_toeplitz

from optid.estimation.covariance import autoregression, covariance
from optid.estimation.initial_trajectory import guess
from optid.estimation.objective import objective_of, with_nuisance_parameters
from optid.estimation.problem import build_problem
from optid.estimation.smoother import Point, descend
from tests.estimation.cart import recording, rig


def coloured(rng, n):
    e, r = rng.standard_normal(n + 200), np.zeros(n + 200)
    for k in range(2, len(r)):
        r[k] = 1.2 * r[k - 1] - 0.5 * r[k - 2] + e[k]
    return r[200:]


def test_an_autoregression_is_found_again():
    r = coloured(np.random.default_rng(1), 20_000)
    coefficients, variance = autoregression([r], len(r))
    assert coefficients[:2] == pytest.approx([1.2, -0.5], abs=0.03)
    assert variance == pytest.approx(1.0, rel=0.03)
    lags = np.array([r[k:] @ r[: len(r) - k] for k in range(len(coefficients) + 1)]) / len(r)
    m = len(coefficients)
    assert coefficients == pytest.approx(solve_toeplitz(lags[:m], lags[1 : m + 1]), abs=1e-9)


def test_nothing_left_has_no_spectrum():
    coefficients, variance = autoregression([np.zeros(100)], 100)
    assert len(coefficients) == 0
    assert variance == 0.0


def test_white_residuals_give_the_interval_of_least_squares(tmp_path):
    """Against one information matrix of parameters and start states alone, from the windows' slopes chained."""
    cart, data = rig(tmp_path), [recording(np.random.default_rng(k), name=f"{k}.csv") for k in range(3)]
    problem = build_problem(cart.model, data, 0.5)
    o, p = objective_of(cart, with_nuisance_parameters(cart), problem)
    q = 1e-4 * o.model.scales
    at, terms, _ = descend(
        replace(o, tolerance=1e-9), Point(guess(cart.model, problem, p), p), q, iterations=50, precision=1e-10
    )
    found = np.sqrt(np.diag(covariance(o, at, terms, q, np.zeros(len(o.free), dtype=bool))))
    nx, heads = len(o.model.states), np.flatnonzero(o.heads)
    information = np.zeros((nx * len(heads) + len(o.free),) * 2)
    for s, (i, j) in enumerate(zip(heads, [*heads[1:], len(problem.begins)], strict=True)):
        # Along a segment every window's start follows from the first: chain the slopes, then add up J'J.
        chain = np.eye(nx, nx + len(o.free))
        for w in range(i, j):
            full = np.vstack([chain, np.eye(nx + len(o.free))[nx:]])
            own = full.T @ terms.H[w] @ full
            places = [*range(nx * s, nx * s + nx), *range(nx * len(heads), len(information))]
            information[np.ix_(places, places)] += own
            chain = terms.slope[w] @ full
    exact = np.sqrt(np.diag(np.linalg.inv(information))[-len(o.free) :])
    assert found == pytest.approx(exact, rel=0.25)
