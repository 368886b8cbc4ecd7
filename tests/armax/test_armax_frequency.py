"""Measured frequency responses, the rig's own poles, and models fitted for a horizon."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from optid.armax import Armax, Orders
from optid.armax.batch import fit_batch
from optid.armax.frequency import measured_response, model_response, step_response
from optid.armax.multistep import expected_error, fit_for_horizon
from optid.armax.physical import physical_poles
from optid.armax.prediction import predict
from optid.armax.signals import Signals
from optid.armax.table2 import HELD_OUT, IN_SAMPLE, Entry, lag_of, last_value, table2
from optid.core.readers import read_recording
from optid.rigs.rigfile import read_rig

DATA = Path(__file__).resolve().parents[2] / "data"
LAG = Armax((1.0, -0.9), ((0.2,),), nk=(2,), sample_time=0.01)


def test_an_open_loop_s_response_is_the_plant_s():
    rng = np.random.default_rng(0)
    u = rng.standard_normal(20_000)
    y = lfilter([0.0, 0.0, 0.2], [1.0, -0.9], u) + 0.1 * rng.standard_normal(u.size)
    found = measured_response(Signals(y, u[:, None]), 0.01)
    expected = model_response(LAG, found.frequency)
    misses = (
        np.abs(found.response - expected) / np.abs(found.response) / np.maximum(found.relative_error, 1e-3)
    )
    assert np.median(misses) < 3.0
    slow = found.frequency < 5.0
    assert found.response[slow] == pytest.approx(expected[slow], rel=0.15)
    assert found.coherence[slow].min() > 0.9 > found.coherence[-5:].mean()
    assert not found.by_reference


def test_in_a_closed_loop_the_reference_tells_and_the_input_lies():
    rng = np.random.default_rng(1)
    N = 160_000
    r, noise = 0.3 * rng.standard_normal(N), lfilter([1.0], [1.0, -0.9], 0.05 * rng.standard_normal(N))
    x, y, u = np.zeros(N), np.zeros(N), np.zeros(N)
    for t in range(2, N):
        x[t] = 0.9 * x[t - 1] + 0.2 * u[t - 2]
        y[t] = x[t] + noise[t]
        u[t] = 0.8 * (r[t] - y[t])
    record = Signals(y, u[:, None])
    open_, closed = measured_response(record, 0.01), measured_response(record, 0.01, reference=r)
    expected = model_response(LAG, closed.frequency)
    low = closed.frequency < 3.0
    lies, tells = (
        np.median(np.abs(f.response - expected)[low] / np.abs(expected)[low]) for f in (open_, closed)
    )
    assert closed.by_reference
    assert tells < 0.3 < lies


def test_too_few_samples_in_a_row_have_none():
    y = np.zeros(2000)
    y[::50] = np.nan
    assert measured_response(Signals(y, np.ones((2000, 1))), 0.01) is None


def test_step_response_goes_to_the_static_gain():
    response = step_response(LAG, 200)
    assert response[:2] == pytest.approx([0.0, 0.0])
    assert response[-1] == pytest.approx(2.0, rel=1e-6)


def test_the_rig_s_poles_are_those_of_its_equations(tmp_path):
    """M a = k u - b v: poles at 0 and -b/M, by hand."""
    rng = np.random.default_rng(0)
    x = np.cumsum(0.01 * np.abs(rng.standard_normal(400))) * 0.01
    rows = np.column_stack([0.01 * np.arange(400), rng.standard_normal(400), 1e3 * x])
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header="t,u,x", comments="")
    (tmp_path / "rig.toml").write_text(
        'name = "axis"\nmodel = "emps"\n[parameters]\nmass = "95 kg"\ndrive_gain = "35 N/V"\n'
        'viscous_friction = "200 N s/m"\ncoulomb_friction = "20 N"\nforce_offset = "0 N"\n[channels]\n'
        'time = { column = "t", unit = "s" }\ncommand = { column = "u", unit = "V" }\n'
        'position = { column = "x", unit = "mm" }\n'
    )
    rig = read_rig(tmp_path / "rig.toml")
    model = Armax((1.0, -1.9, 0.9), ((1e-4,),), nk=(1,), sample_time=0.01)
    recording = read_recording(tmp_path / "run.csv", rig)
    position = np.where(np.arange(400) % 10, np.nan, recording["position"].values)
    slower = {**recording.channels, "position": replace(recording["position"], values=position)}
    poles, _ = physical_poles(rig, replace(recording, channels=slower), "position", model)
    assert poles  # measured at a tenth of the rows
    poles, taken = physical_poles(rig, recording, "position", model)
    slow = sorted((p for p in poles if abs(p.pole) < 50.0), key=lambda p: abs(p.pole))
    assert slow[0].pole == pytest.approx(0.0, abs=1e-6)
    assert any(p.pole == pytest.approx(-200 / 95, rel=1e-3) for p in slow)
    assert slow[0].nearest == pytest.approx(1.0)
    assert "position" in taken


def test_a_right_model_is_the_same_at_every_horizon_and_a_wrong_one_is_not():
    rng = np.random.default_rng(3)
    a, b, c = [1.0, -1.5, 0.7], [0.0, 1.0, 0.5], [1.0, -0.6]
    u = np.where(np.cumsum(rng.random(3000) < 0.2) % 2, 1.0, -1.0)
    y = lfilter(b, a, u) + lfilter(c, a, 0.3 * rng.standard_normal(3000))
    record = Signals(y, u[:, None])
    right = fit_batch([record], Orders.of(2, 2, 1)).model
    again = fit_for_horizon([record], right, 5)
    assert again.theta == pytest.approx(right.theta, abs=0.06)
    error = predict(right, y, u, 5) - y
    assert np.nanstd(error) == pytest.approx(expected_error(right, 5), rel=0.05)
    wrong = fit_batch([record], Orders.of(1, 1, 1)).model
    fitted = fit_for_horizon([record], wrong, 5)

    def missed(model, steps):
        return float(np.nanmean((predict(model, y, u, steps) - y) ** 2))

    assert missed(fitted, 5) < 0.97 * missed(wrong, 5)
    assert missed(fitted, 1) > missed(wrong, 1)


def test_lags_are_those_of_the_prediction():
    y = np.cumsum(np.cumsum(np.random.default_rng(0).standard_normal(2000))) / 100
    assert lag_of(y, last_value(y, 5), 5) == pytest.approx(5.0, abs=0.01)
    assert lag_of(y, 0.5 * (last_value(y, 2) + last_value(y, 3)), 4) == pytest.approx(2.5, abs=0.05)
    assert lag_of(y, y, 3) == pytest.approx(0.0, abs=0.01)


def test_both_parts_stand_in_the_table():
    rng = np.random.default_rng(0)
    u = rng.standard_normal(1000)
    y = lfilter([0.0, 0.0, 0.2], [1.0, -0.9], u)
    worse = Armax((1.0, -0.5), ((0.2,),), nk=(2,), sample_time=0.01)
    table = table2(y, u, [Entry(1, 1, LAG, worse)], cut=700)
    [own], [other] = table.errors(IN_SAMPLE), table.errors(HELD_OUT)
    assert (own["samples"], other["samples"]) == (998, 300)
    assert own["mean_square_error"] < 1e-20 < other["mean_square_error"]
