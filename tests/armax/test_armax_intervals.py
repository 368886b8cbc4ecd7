"""Residuals before a recording, and intervals by profile likelihood."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import chi2
from scipy.stats import t as student

from optid.armax import Armax, Orders, profile
from optid.armax.audit import audit
from optid.armax.batch import fit_batch, placed
from optid.armax.freedom import VarianceSlopes
from optid.armax.gradient import Problem
from optid.armax.identifiability import follows_output, loop_share
from optid.armax.prediction import innovations
from optid.armax.profile import profile_intervals, wald_intervals
from optid.armax.signals import Signals, signals
from optid.armax.trend import Trend

POLES = (0.92, 0.74 + 0.26j, 0.74 - 0.26j)


def switching(rng, samples):
    return np.where(np.cumsum(rng.random(samples) < 0.05) % 2, 1.0, -1.0)


def of_sensor(seed, poles=POLES, samples=1500):
    """A system whose noise is the sensor's, C = A, and a recording of it."""
    rng = np.random.default_rng(seed)
    a = np.real(np.poly(poles))
    truth = Armax(tuple(a), (tuple(np.full(len(poles), np.sum(a) / len(poles))),), tuple(a), (1,))
    u = switching(rng, samples)
    y = lfilter(np.r_[0.0, truth.b[0]], truth.a, u) + 0.05 * rng.standard_normal(samples)
    return truth, Signals(y, u[:, None])


def test_the_gradient_holds_with_the_residuals_before_each_run():
    rng = np.random.default_rng(0)
    y, u = 0.1 * np.cumsum(rng.standard_normal(900)), rng.standard_normal(900)
    y[500:510] = np.nan
    problem = Problem.of([signals(y, u)], Orders.of(2, 2, 2))
    assert len(problem.openings[0]) == 2
    theta = np.array([-1.5, 0.7, 0.3, 0.2, -1.2, 0.5])
    R = problem.information(theta)
    steps = 1e-6 * np.eye(theta.size)
    slope = [(problem.loss(theta + step) - problem.loss(theta - step)) / 2e-6 for step in steps]
    assert -2.0 * R[:6, :6].T @ R[:6, 6] / problem.count == pytest.approx(slope, rel=1e-4)
    assert float(np.sum(R[:, 6] ** 2)) / problem.count == pytest.approx(problem.loss(theta), rel=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_the_truth_is_no_less_likely_than_chance_allows_where_c_forgets_slowly(seed):
    """With residuals of zero before the recording -2 log likelihood grows by 102 for the second seed."""
    truth, record = of_sensor(seed)
    fit = fit_batch([record], truth.orders)
    _, problem, theta = placed([record], truth, Trend.NONE)
    growth = problem.count * math.log(problem.loss(theta) * record.scales[0] ** 2 / fit.loss)
    assert 0.0 <= growth < chi2.ppf(0.999, theta.size)


def test_predictions_start_as_the_fit_did():
    truth, record = of_sensor(1)
    fit = fit_batch([record], truth.orders)
    started = innovations(fit.model, record.y, record.u, estimated_start=True)
    assert np.nanmean(started**2) == pytest.approx(fit.loss, rel=0.01)
    assert np.nanmean(innovations(fit.model, record.y, record.u) ** 2) > 1.05 * fit.loss


def test_intervals_are_the_delta_method_s_where_much_is_known():
    truth, record = of_sensor(0, (0.9, 0.7), 6000)
    model = fit_batch([record], truth.orders).model
    found, first = profile_intervals([record], model, Trend.NONE), wald_intervals(model)
    for (low, high), (a, b) in zip(
        [*found.poles, *found.static_gains], [*first.poles, *first.static_gains], strict=True
    ):
        assert [low, high] == pytest.approx([a, b], abs=0.15 * (b - a))
    assert found.poles[0][0] <= 0.9 <= found.poles[0][1]
    assert found.static_gains[0][0] <= 1.0 <= found.static_gains[0][1]


def test_ends_of_an_interval_cost_what_chance_allows():
    """By hand: a first-order model's gain held at an end, the rest fitted anew, raises -2 log likelihood by 3.84."""
    rng = np.random.default_rng(2)
    u, e = switching(rng, 60), 0.3 * rng.standard_normal(60)
    y = lfilter([0.0, 0.1], [1.0, -0.9], u) + lfilter([1.0], [1.0, -0.9], e)
    record = Signals(y, u[:, None])
    model = fit_batch([record], Orders.of(1, 1, 0)).model
    ends, first = (
        f.static_gains[0] for f in (profile_intervals([record], model, Trend.NONE), wald_intervals(model))
    )
    past, now, before = y[:-1], y[1:], u[:-1]
    best = np.sum((now + model.a[1] * past - model.b[0][0] * before) ** 2)

    def growth(gain):  # y(t) - gain u(t-1) = p (y(t-1) - gain u(t-1))
        before_, now_ = past - gain * before, now - gain * before
        left = np.sum((now_ - np.dot(before_, now_) / np.sum(before_**2) * before_) ** 2)
        return 59 * math.log(left / best)

    assert [growth(end) for end in ends] == pytest.approx([3.84, 3.84], abs=0.25)
    assert max(abs(growth(end) - 3.84) for end in first) > 0.5


def slopes(record, orders):
    fit = fit_batch([record], orders)
    _, problem, theta = placed([record], fit.model, Trend.NONE)
    found = VarianceSlopes.at(problem, theta, problem.loss(theta))
    gain = np.r_[-np.ones(orders.na) * sum(fit.model.b[0]) / sum(fit.model.a), np.ones(orders.nb[0])]
    return fit.model, problem, found, np.r_[gain, np.zeros(orders.nc)]


def test_a_regression_has_as_many_degrees_of_freedom_as_residuals_less_parameters():
    _, record = of_sensor(0, (0.9,), 300)
    _, problem, found, row = slopes(record, Orders.of(1, 1, 0))
    assert found.freedom(row) == pytest.approx(problem.count - 2)
    assert found.quantile(row) == pytest.approx(student.ppf(0.975, problem.count - 2))


def test_a_gain_s_variance_varies_from_draw_to_draw_as_its_degrees_of_freedom_say():
    logs, freedoms = [], []
    for seed in range(40):
        _, record = of_sensor(seed, (0.9,), 2000)
        model, _, found, row = slopes(record, Orders.of(1, 1, 1))
        wald = wald_intervals(model).static_gains[0]
        logs.append(2 * math.log(wald[1] - wald[0]))
        freedoms.append(found.freedom(row))
    assert 0.5 < np.median(freedoms) * np.var(logs) / 2 < 2.0  # exactly 1 in endless recordings
    assert np.median(freedoms) < 200


def test_a_pole_too_many_has_a_wide_interval_and_leaves_the_others_theirs():
    rng = np.random.default_rng(5)
    u = switching(rng, 2000)
    y = lfilter([0.0, 0.1], [1.0, -0.9], u) + lfilter(
        [1.0, 0.3], [1.0, -0.9], 0.05 * rng.standard_normal(2000)
    )
    model = fit_batch([(y, u)], Orders.of(2, 2, 2)).model
    found = profile_intervals([Signals(y, u[:, None])], model, Trend.NONE)
    poles = np.roots(model.a)
    for pole, (low, high) in zip(poles, found.poles, strict=True):
        if abs(pole - 0.9) < 0.05:
            assert low <= 0.9 <= high
            assert high - low < 0.1
        else:
            assert high - low > 0.3


def test_a_gain_s_lopsided_interval_is_told_by_its_limits():
    truth, record = of_sensor(0)
    model = fit_batch([record], truth.orders).model
    intervals = wald_intervals(model)
    even = next(f.text for f in audit(model).findings if f.name == "static_gain")
    assert "±" in even
    lopsided = type(intervals)(intervals.poles, ((0.9, 1.4),))
    said = next(f.text for f in audit(model, intervals=lopsided).findings if f.name == "static_gain")
    assert "between 0.9 and 1.4" in said
    open_ = type(intervals)(intervals.poles, ((-0.2, math.inf),))
    assert any(f.name == "static_gain_unknown" and f.grave for f in audit(model, intervals=open_).findings)


def test_a_side_on_which_no_step_succeeds_is_open(monkeypatch):
    """Nearly an integrator: beside the best gain the search may find no place at all; that is no end."""
    real = profile._end

    def stuck_above(root, begin, step, bound):
        return begin[0] + 1e-9 * step if step > 0 else real(root, begin, step, bound)

    _, record = of_sensor(5)
    model = fit_batch([record], Orders.of(3, 3, 3)).model
    whole = profile_intervals([record], model, Trend.NONE).static_gains[0]
    monkeypatch.setattr(profile, "_end", stuck_above)
    low, high = profile_intervals([record], model, Trend.NONE).static_gains[0]
    assert low == pytest.approx(whole[0])
    assert math.isfinite(whole[1])
    assert high == math.inf


def test_a_loop_that_only_its_converter_excites():
    rng = np.random.default_rng(3)
    e, y, u = 0.01 * rng.standard_normal(3000), np.zeros(3000), np.zeros(3000)
    for t in range(1, 3000):
        y[t] = 0.95 * y[t - 1] + 0.05 * u[t - 1] + e[t]
        u[t] = np.round(-2.0 * y[t], 3)
    assert follows_output(signals(y, u)) == ()
    ((input, share),) = loop_share(signals(y, u))
    assert input == 0
    assert share == pytest.approx(1e-3 / math.sqrt(12.0) / np.std(u), rel=0.1)
    assert loop_share(signals(y, switching(rng, 3000))) == ()
    smooth = np.sin(0.01 * np.arange(3000.0))
    assert loop_share(signals(lfilter([0.0, 0.1], [1.0, -0.9], smooth), smooth)) == ()
