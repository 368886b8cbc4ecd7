"""How sure a node is after a piece of data: Kalman's formulas, also where slopes are as large as rounding allows."""

from types import SimpleNamespace

import numpy as np
import pytest

from optid.estimation.moving_horizon import _arrival, _Uncertainty

SCALES, Q = np.array([0.5, 2.0, 1.0]), np.array([0.1, 0.2, 0.3])


def pieces(rng, gain=1.0):
    """Two pieces of data: information, gradient and slope to the end, of sensors with slopes J."""
    J, r = gain * rng.normal(size=(2, 2, 3)), rng.normal(size=(2, 2))
    return SimpleNamespace(
        H=np.einsum("kai,kaj->kij", J, J),
        g=np.einsum("kai,ka->ki", J, r),
        slope=rng.normal(size=(2, 3, 3)),
        end=rng.normal(size=(2, 3)),
    )


def test_covariances_are_those_of_a_filter_with_the_assumed_gain():
    rng = np.random.default_rng(1)
    terms, A, B = pieces(rng), rng.normal(size=(3, 3)), rng.normal(size=(3, 3))
    after = _Uncertainty(A @ A.T, B @ B.T).after(terms, 1, Q, SCALES)
    H = terms.H[1] * np.outer(SCALES, SCALES)
    slope = terms.slope[1] * SCALES / SCALES[:, None]
    left = np.linalg.inv(np.linalg.inv(A @ A.T) + H)
    kept = np.eye(3) - left @ H
    assert after.assumed == pytest.approx(slope @ left @ slope.T + np.diag((Q / SCALES) ** 2), rel=1e-9)
    actual = slope @ (kept @ B @ B.T @ kept.T + left @ H @ left.T) @ slope.T
    assert after.actual == pytest.approx(actual, rel=1e-9)


def test_a_prior_arrives_with_what_its_pieces_told():
    rng = np.random.default_rng(2)
    terms = pieces(rng)
    past = SimpleNamespace(start=rng.normal(size=3), spread=np.array([1.0, 0.3, 2.0]))
    found = SimpleNamespace(X=rng.normal(size=(2, 3)))
    mean, sd = past.start, past.spread
    for k in range(2):
        left = np.linalg.inv(terms.H[k] + np.diag(1 / sd**2))
        move = left @ (terms.g[k] - (found.X[k] - mean) / sd**2)
        mean = terms.end[k] + terms.slope[k] @ move
        sd = np.sqrt(np.diag(terms.slope[k] @ left @ terms.slope[k].T) + Q**2)
    arrived = _arrival(past, found, terms, Q, 2)
    assert arrived[0] == pytest.approx(mean, rel=1e-9)
    assert arrived[1] == pytest.approx(sd, rel=1e-9)


def test_slopes_of_a_kink_leave_the_other_directions_as_they_were():
    """A sticking axis has slopes of 1e13: in its information matrix rounding hides every other direction."""
    rng = np.random.default_rng(3)
    steep = 1e13 * np.array([1.0, 160.0, -28.0])
    terms = pieces(rng)
    terms.H[:] = np.outer(steep, steep) + 1e11 * rng.normal(size=(3, 3))
    terms.H[:] = 0.5 * (terms.H + terms.H.transpose(0, 2, 1))
    terms.g[:] = steep
    terms.slope[:] = np.outer([1.0, 2.0, 3.0], steep)
    one = np.ones(3)
    after = _Uncertainty(np.eye(3), 0.5 * np.eye(3)).after(terms, 0, Q, one)
    for covariance in (after.assumed, after.actual):
        assert np.isfinite(covariance).all()
        assert np.linalg.eigvalsh(covariance).min() > -1e-9
        assert np.abs(covariance).max() < 30.0  # a prediction from one known direction, not from rounding
    past = SimpleNamespace(start=np.zeros(3), spread=one)
    mean, sd = _arrival(past, SimpleNamespace(X=np.zeros((2, 3))), terms, Q, 1)
    assert np.isfinite(mean).all()
    assert np.abs(mean - terms.end[0]).max() < 30.0
    assert sd.max() < 30.0
