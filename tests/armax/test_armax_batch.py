"""The batch reference: its gradient, its minimum, starts and gaps; choice of orders; residual tests."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from optid.armax import Armax, Orders
from optid.armax.batch import Outcome, fit_batch
from optid.armax.gradient import residuals_and_gradient
from optid.armax.order_selection import compare_orders, grid
from optid.armax.regression import triangle
from optid.armax.residuals import residual_tests
from optid.armax.signals import signals, usable
from optid.errors import InputError, NotIdentifiable


def test_gradient_is_casadi_s(truth, simulated):
    """The recursion for psi against automatic differentiation of e = (A y - B u)/C written in CasADi."""
    y, u = simulated(truth, 80, 0)
    o, theta = truth.orders, ca.SX.sym("theta", truth.orders.parameters)
    e: list[ca.SX] = []
    for t in range(80):
        if t < o.reach:
            e.append(ca.SX(0))
            continue
        guess = -sum(theta[k] * y[t - 1 - k] for k in range(4))
        guess += sum(theta[4 + k] * u[t - 11 - k, 0] for k in range(3))
        guess += sum(theta[7 + k] * e[t - 1 - k] for k in range(2))
        e.append(y[t] - guess)
    residuals = ca.vertcat(*e)
    function = ca.Function("f", [theta], [residuals, ca.jacobian(residuals, theta)])
    expected_e, expected_J = (np.array(x) for x in function(truth.theta * 1.01))
    record = signals(y, u)
    found_e, Psi = residuals_and_gradient(record, usable(record, o), o, truth.theta * 1.01)
    assert found_e == pytest.approx(expected_e.ravel(), abs=1e-10)
    assert -Psi == pytest.approx(expected_J, abs=1e-9)


def test_known_truth_is_found_from_every_start(truth, simulated):
    errors = []
    for seed in range(2):
        y, u = simulated(truth, 4001, seed)
        fit = fit_batch([(y, u)], truth.orders)
        assert fit.outcome is Outcome.CONVERGED
        assert fit.determined
        errors.append(np.linalg.norm(fit.model.theta - truth.theta) / np.linalg.norm(truth.theta))
        assert fit.starts[-1][1] == pytest.approx(fit.loss, rel=1e-6)
    assert np.median(errors) < 0.013
    assert max(errors) < 0.05


def test_several_recordings_and_gaps_count_together(truth, simulated):
    parts = [simulated(truth, 1500, seed) for seed in range(3)]
    parts[1][0][700:705] = np.nan
    fit = fit_batch(parts, truth.orders)
    alone = fit_batch(parts[:1], truth.orders)
    assert np.mean(fit.model.standard_errors) < 0.7 * np.mean(alone.model.standard_errors)
    assert (fit.model.theta - truth.theta) / fit.model.standard_errors == pytest.approx(0.0, abs=4.0)
    assert fit.samples == 3 * (1500 - truth.orders.reach) - 5 - truth.orders.na


def test_units_scale_through(truth, simulated):
    y, u = simulated(truth, 1000, 0)
    here, there = fit_batch([(y, u)], truth.orders).model, fit_batch([(1e-3 * y, 5 * u)], truth.orders).model
    assert there.a == pytest.approx(here.a, rel=1e-6)
    assert np.array(there.b[0]) * 5e3 == pytest.approx(np.array(here.b[0]), rel=1e-6)
    assert there.noise_variance == pytest.approx(1e-6 * here.noise_variance, rel=1e-6)


def test_a_silent_input_is_not_determined():
    y = np.random.default_rng(0).standard_normal(300)
    assert not fit_batch([(y, np.zeros(300))], Orders.of(1, 1, 1)).determined


def test_too_short_is_refused():
    with pytest.raises(NotIdentifiable, match="cannot determine"):
        fit_batch([(np.zeros(10), np.zeros(10))], Orders.of(4, 4, 4))


SMALL = Armax(a=(1.0, -1.5, 0.7), b=((1.0, 0.5),), c=(1.0, -0.6), nk=(2,), noise_variance=0.1)


def test_right_models_fail_the_residual_tests_as_often_as_stated(simulated):
    """At a rate of 0.2 the failures among 120 right models lie within a binomial's 99.9 % range."""
    failed = 0
    for seed in range(120):
        y, u = simulated(SMALL, 400, seed, switch=0.3)
        model = fit_batch([(y, u)], SMALL.orders).model
        tests = residual_tests(model, y, u, error_rate=0.2, lags=10)
        failed += not (tests.white and tests.independent)
    assert 8 <= failed <= 40


def test_wrong_models_fail_where_they_are_wrong(simulated):
    y, u = simulated(SMALL, 2000, 0, switch=0.3)
    no_noise_model = residual_tests(fit_batch([(y, u)], Orders.of(2, 2, 0, 2)).model, y, u)
    assert not no_noise_model.white
    wrong_path = residual_tests(fit_batch([(y, u)], Orders(2, (1,), 3, (5,))).model, y, u)
    assert not wrong_path.independent
    unseen = simulated(SMALL, 2000, 1, switch=0.3)
    right = residual_tests(fit_batch([(y, u)], SMALL.orders).model, *unseen, fitted=False)
    assert right.white
    assert right.independent


def test_orders_and_delay_are_recommended(simulated):
    y, u = simulated(SMALL, 3000, 0, switch=0.3)
    table = compare_orders(y, u, grid([1, 2, 3], [1, 2, 3]))
    assert (table.recommended.na, table.recommended.nk) == (2, (2,))
    assert "order 2 with a delay of 2 samples" in table.words
    frame = table.frame()
    assert frame["recommended"].sum() == 1
    best = table.rows[4]
    N, p, V = best.fit.samples, 6, best.fit.loss
    assert best.aic == pytest.approx(N * np.log(V) + 2 * p)
    assert best.bic == pytest.approx(N * np.log(V) + p * np.log(N))
    assert best.fpe == pytest.approx(V * (1 + p / N) / (1 - p / N))
    assert best.fit_one_step > best.fit_ten_steps > 0


def test_orders_that_cannot_be_fitted_are_named(simulated):
    y, u = simulated(SMALL, 60, 0, switch=0.3)
    table = compare_orders(y, u, grid([1, 15], [1]))
    assert table.refused[0][0].na == 15
    with pytest.raises(NotIdentifiable):
        compare_orders(y, u, grid([15], [1]))
    with pytest.raises(InputError, match="held_out"):
        compare_orders(y, u, grid([1], [1]), held_out=2.0)


@pytest.mark.parametrize("shape", [(3, 5), (13, 13), (700, 7), (513, 4)], ids=str)
def test_triangle_is_qr_s(shape):
    tall = np.random.default_rng(0).standard_normal(shape)
    tall[:, -1] = tall[:, 0] + 1e-9 * tall[:, -1]
    R = triangle(tall)
    gram = R.T @ R
    assert gram == pytest.approx(tall.T @ tall, rel=1e-12, abs=1e-12 * shape[0])
    rows = min(shape)
    assert np.abs(R[:rows]) == pytest.approx(np.abs(np.linalg.qr(tall, mode="r")), abs=1e-13 * shape[0])
    assert np.array_equal(triangle(np.zeros(shape)), np.zeros((shape[1], shape[1])))
