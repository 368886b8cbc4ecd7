"""First guess of the node states: parabolas through measurements, the rest carried along."""

import numpy as np
import pytest

from optid.estimation.initial_trajectory import guess, measured_states
from optid.estimation.problem import build_problem
from tests.estimation.cart import RATE, TRUTH, record, rig

STEPS = 100  # samples for which the push is held: nodes at half a second stand at its jumps


def parabola(n, begin=0.0):
    t = begin + np.arange(n) / RATE
    return 0.1 + 0.5 * t - 0.3 * t**2, 0.5 - 0.6 * t


def guessed(cart, data, window=0.5):
    problem = build_problem(cart.model, data, window)
    return problem, guess(cart.model, problem, cart.model.vector(cart.parameters))


def test_a_parabola_is_read_off_exactly(tmp_path):
    cart, (x, v) = rig(tmp_path), parabola(401)
    assert measured_states(cart.model) == ({0: 0}, {1: 0})
    problem, X = guessed(cart, [record(np.zeros(401), x), record(np.zeros(401), x)])
    assert X[:, 0] == pytest.approx(np.tile(x, 2)[problem.begins], abs=1e-12)
    assert X[:, 1] == pytest.approx(np.tile(v, 2)[problem.begins], abs=1e-9)


def test_missing_neighbours_count_for_nothing(tmp_path):
    cart, (x, v) = rig(tmp_path), parabola(401)
    x[90:100:2] = 99.0
    x[195:206] = np.nan
    holed = np.where(x == 99.0, np.nan, x)
    problem, X = guessed(cart, [record(np.zeros(401), holed)])
    assert X[:, 0] == pytest.approx(
        0.1 + 0.5 * problem.time[problem.begins] - 0.3 * problem.time[problem.begins] ** 2
    )
    assert X[:, 1] == pytest.approx(v[problem.begins])


def test_what_is_not_measured_is_carried(tmp_path):
    """Where nothing is known around a node, the model goes on from the node before."""
    cart = rig(tmp_path, gain=TRUTH["gain"], drag=TRUTH["drag"])
    x = np.zeros(401)
    x[80:121] = np.nan
    problem, X = guessed(cart, [record(np.r_[np.ones(100), np.zeros(301)], x)])
    assert problem.begins[1] == STEPS
    final, decay = TRUTH["gain"] / TRUTH["drag"], np.exp(-TRUTH["drag"] * 0.5)
    assert X[1, 1] == pytest.approx(final * (1 - decay), rel=1e-3)
    assert X[1, 0] == pytest.approx(final * (0.5 - (1 - decay) / TRUTH["drag"]), rel=1e-3)
    assert X[2] == pytest.approx([0.0, 0.0], abs=1e-12)
