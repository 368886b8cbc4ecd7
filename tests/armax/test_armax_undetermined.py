"""What the data cannot tell is said, and an operating point and a trend are part of the model."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from scipy.signal import lfilter

from optid.armax import Armax, Orders
from optid.armax.audit import audit
from optid.armax.batch import fit_batch
from optid.armax.files import from_survey, load, save
from optid.armax.identifiability import Reason, excitation, follows_output, rounding
from optid.armax.plan import Plan
from optid.armax.prediction import innovations, predict, simulate
from optid.armax.signals import signals
from optid.armax.survey import survey
from optid.armax.trend import Trend, find_trend
from optid.errors import InputError
from optid.tuning.plant import scenarios

FIRST = Orders.of(1, 1, 1)
LAG = Armax((1.0, -0.95), ((1e-4,),), nk=(1,))  # gain 2e-3


def first_order(N=3000, seed=0, noise=1e-5):
    """u, and y of gain 2 mm/V and pole 0.95 with noise of the sensor."""
    rng = np.random.default_rng(seed)
    u = np.where(np.cumsum(rng.random(N) < 0.1) % 2, 0.5, -0.5)
    y = lfilter([0.0, 1e-4], [1.0, -0.95], u)
    return u, y + noise * rng.standard_normal(N)


def gain(model):
    return sum(model.b[0]) / sum(model.a)


def test_an_operating_point_is_part_of_the_model():
    u, y = first_order()
    away = fit_batch([(y + 0.05, u + 3.0)], FIRST, trend=Trend.CONSTANT)
    near = fit_batch([(y, u)], FIRST, trend=Trend.CONSTANT)
    assert gain(away.model) == pytest.approx(2e-3, rel=0.01)
    assert away.model.a[1] == pytest.approx(-0.95, abs=2e-3)
    assert away.model.theta == pytest.approx(near.model.theta, rel=1e-5)
    assert away.model.standard_errors == pytest.approx(near.model.standard_errors, rel=1e-4)
    without = fit_batch([(y + 0.05, u + 3.0)], FIRST).model
    assert abs(gain(without) - 2e-3) > 5e-4  # what it was before
    assert away.model.constant == pytest.approx(0.05 * 0.05 - 3.0 * 1e-4, rel=0.05)


def test_a_trend_is_part_of_the_model_and_extrapolated():
    u, y = first_order()
    drift = 0.02 * np.arange(y.size) / y.size
    assert find_trend([signals(y + drift, u)], FIRST) is Trend.LINEAR
    assert find_trend([signals(y + 1.0, u)], FIRST) is Trend.CONSTANT
    model = fit_batch([(y + drift, u)], FIRST, 0.01, trend=Trend.LINEAR).model
    assert gain(model) == pytest.approx(2e-3, rel=0.01)
    assert model.slope == pytest.approx(
        0.05 * 0.02 / (y.size * 0.01), rel=0.05
    )  # A(1) times the drift a second
    part = slice(2000, 2600)
    e = innovations(model, (y + drift)[part], u[part], first=2000)
    assert np.nanstd(e) < 1.5e-5
    assert np.nanmean(predict(model, (y + drift)[part], u[part], 5, first=2000) - (y + drift)[part]) < 1e-5
    free = simulate(model, u, (y + drift)[:1], since=0)
    assert np.std(free - y - drift) < 2e-4


def test_a_regulator_without_excitation_is_not_identifiable(tmp_path):
    rng = np.random.default_rng(1)
    e, y, u = 1e-5 * rng.standard_normal(4000), np.zeros(4000), np.zeros(4000)
    for t in range(1, 4000):
        y[t] = 0.9 * y[t - 1] + 0.1 * u[t - 1] + e[t]
        u[t] = -0.4 * y[t - 1]
    assert follows_output(signals(y, u)) == (0,)
    found = survey(y, u, 0.01, Plan(orders=(1, 2), steps=(1,), delay=1, horizons=False))
    for candidate in found.candidates:
        assert "feedback" in {f.name for f in candidate.audit.findings if f.grave}
        assert np.all(np.isinf(candidate.model.standard_errors))
        assert math.isinf(candidate.audit.static_gain_error)
    save(tmp_path / "armax.json", from_survey(found))
    again = load(tmp_path / "armax.json")
    assert np.all(np.isinf(again.chosen.standard_errors))
    document = json.loads((tmp_path / "armax.json").read_text())
    assert document["models"][0]["covariance"][0][0] is None
    assert document["models"][0]["static_gain"][0]["ci95"] is None
    with pytest.raises(InputError, match="infinite"):
        scenarios(again.chosen, 5, rng)
    assert len(scenarios(again.chosen, 1, rng)) == 1


def test_a_loop_with_a_moving_reference_is_identifiable():
    rng = np.random.default_rng(1)
    r = np.where(np.cumsum(rng.random(4000) < 0.02) % 2, 1.0, -1.0)
    y, u = np.zeros(4000), np.zeros(4000)
    for t in range(1, 4000):
        y[t] = 0.9 * y[t - 1] + 0.1 * u[t - 1] + 0.01 * rng.standard_normal()
        u[t] = 0.4 * (r[t] - y[t])
    assert follows_output(signals(y, u)) == ()
    fit = fit_batch([(y, u)], FIRST, trend=Trend.CONSTANT)
    assert fit.determined
    assert fit.model.theta[:2] == pytest.approx([-0.9, 0.1], abs=0.02)


def test_one_sine_tells_two_numbers_of_b():
    rng = np.random.default_rng(2)
    u = np.round(np.sin(2 * np.pi * np.arange(4000) / 100), 8)
    y = lfilter([0.0, 2e-4, 1.8e-4], [1.0, -1.7, 0.74], u) + 1e-5 * rng.standard_normal(4000)
    assert excitation(u) == 2
    assert excitation(np.round(u + np.sin(np.arange(4000)), 8)) == 4
    assert excitation(rng.standard_normal(4000)) == 24
    fit = fit_batch([(y, u)], Orders.of(3, 3, 3), trend=Trend.CONSTANT)
    assert [d.reason for d in fit.open] == [Reason.POOR_EXCITATION]
    assert np.isinf(fit.model.standard_errors).tolist() == [False] * 3 + [True] * 3 + [False] * 3
    assert max(map(abs, fit.model.b[0])) < 1.0  # rounding is not taken for an input
    names = {
        f.name
        for f in survey(y, u, 0.01, Plan(orders=(3,), steps=(1,), delay=1)).chosen.audit.findings
        if f.grave
    }
    assert {"poor_excitation", "static_gain_unknown"} <= names


@pytest.mark.parametrize(
    ("second", "reason"),
    [(lambda u: 0.0 * u + 3.0, Reason.IDLE_INPUT), (lambda u: 2.0 * u + 1.0, Reason.FOLLOWING_INPUTS)],
    ids=["idle", "following"],
)
def test_inputs_that_say_nothing_of_their_own(second, reason):
    u, y = first_order()
    fit = fit_batch(
        [(y, np.column_stack([u, second(u)]))], Orders.of(1, (1, 1), 1, (1, 1)), trend=Trend.CONSTANT
    )
    assert [d.reason for d in fit.open] == [reason]
    told = [False, reason is Reason.FOLLOWING_INPUTS, True, False]
    assert np.isinf(fit.model.standard_errors).tolist() == told
    assert fit.model.a[1] == pytest.approx(-0.95, abs=2e-3)


def test_an_order_too_high_without_noise_is_a_common_factor():
    u = np.random.default_rng(0).standard_normal(800)
    y = lfilter([0.0, 0.5], [1.0, -0.8], u)
    fit = fit_batch([(y, u)], Orders.of(2, 2, 0, 1))
    assert [d.reason for d in fit.open] == [Reason.COMMON_FACTOR]


def test_levels_are_no_rounding_and_digits_are():
    rng = np.random.default_rng(0)
    assert rounding(np.where(rng.random(500) < 0.5, 2.5, 3.5)) < 1e-14
    assert rounding(np.round(rng.standard_normal(500), 5)) == pytest.approx(1e-5)
    assert rounding(np.round(rng.standard_normal(500), 1)) < 1e-14
    assert rounding(np.round(rng.standard_normal(500), 4) * 1e-3) == pytest.approx(1e-7)
    assert rounding(rng.standard_normal(500)) < 1e-11


def test_a_pole_that_a_root_of_c_cancels_is_seen():
    sensor = audit(Armax((1.0, -0.95), ((0.1,),), (1.0, -0.952), (1,)))
    [pair] = sensor.noise_cancellations
    assert not pair.empty
    assert [f.grave for f in sensor.findings if f.name == "noise_cancellation"] == [False]
    spare = Armax(
        tuple(np.poly([0.9, -0.949])), (tuple(np.poly([-0.9485]) * 0.1),), tuple(np.poly([0.3, -0.956])), (1,)
    )
    found = audit(spare)
    assert [f.grave for f in found.findings if f.name == "common_factor"] == [True]
    text = next(f.text for f in found.findings if f.name == "common_factor")
    assert "-0.9490" in text and "-0.9560" in text


def test_intervals_hold_the_truth_as_often_as_they_say():
    """Among 12 draws with offsets and trends 95 % intervals hold poles and static gain in a binomial's 99.9 % range."""
    from studies.armax_coverage import covered

    rows = [covered(np.random.default_rng([5, k]), 600, bool(k % 2)) for k in range(12)]
    assert sum(row["gain_profile"] for row in rows) >= 8
    assert sum(row["poles_profile"] for row in rows) >= 0.8 * sum(row["poles"] for row in rows)
