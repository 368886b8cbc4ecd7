"""Predictions through the noise model against an independent formula, and simulation against scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from optid.armax import Armax
from optid.armax.prediction import fit_percent, innovations, predict, prediction_frame, simulate
from optid.errors import InputError, RecordingError


def diophantine(model: Armax, y: np.ndarray, u: np.ndarray, k: int) -> np.ndarray:
    """yhat(t | t-k) = (B F_k / C) u(t) + (G_k / C) y(t-k) with C = A F_k + q^-k G_k, from zeros."""
    a, c = np.array(model.a), np.array(model.c)
    F = lfilter(c, a, np.eye(1, k)[0])
    product = np.convolve(a, F)
    rest = np.zeros(max(c.size, product.size))
    rest[: c.size] += c
    rest[: product.size] -= product
    G = rest[k:]
    old = np.concatenate([np.zeros(k), y[: y.size - k]])
    out = lfilter(G, c, old) if G.size else np.zeros(y.size)
    for i, (b, nk) in enumerate(zip(model.b, model.nk, strict=True)):
        out = out + lfilter(np.convolve(np.concatenate([np.zeros(nk), b]), F), c, u[:, i])
    return out


@pytest.mark.parametrize("steps", [1, 2, 5, 10, 37])
def test_prediction_solves_the_diophantine_equation(truth, simulated, steps):
    y, u = simulated(truth, 600, 0)
    guess = predict(truth, y, u, steps)
    assert np.isnan(guess[: truth.orders.reach + steps - 1]).all()
    # The start differs (measured outputs there, zeros here); it dies out as the roots of C do.
    assert guess[200:] == pytest.approx(diophantine(truth, y, u, steps)[200:], abs=1e-9)


def test_innovations_of_the_truth_are_the_noise(truth, simulated):
    y, u = simulated(truth, 4000, 1)
    assert np.nanvar(innovations(truth, y, u)) == pytest.approx(0.01, rel=0.1)


def test_longer_horizons_are_harder_and_better_than_repeating_one_step(truth, simulated):
    y, u = simulated(truth, 4000, 1)
    errors = [np.nanstd(predict(truth, y, u, k) - y) for k in (1, 5, 10)]
    assert errors[0] < errors[1] < errors[2]
    variance = 0.01 * np.cumsum(lfilter(truth.c, truth.a, np.eye(1, 10)[0]) ** 2)
    assert np.square(errors) == pytest.approx(variance[[0, 4, 9]], rel=0.15)


def test_simulation_is_the_filter(truth, simulated):
    _, u = simulated(truth, 500, 2)
    expected = lfilter(np.concatenate([np.zeros(11), truth.b[0]]), truth.a, u[:, 0])
    assert simulate(truth, u) == pytest.approx(expected, abs=1e-9)
    assert simulate(truth, u, expected[:40])[40:] == pytest.approx(expected[40:], abs=1e-9)


def test_a_missing_output_is_bridged(truth, simulated):
    y, u = simulated(truth, 500, 2)
    full = predict(truth, y, u, 1)
    holed = y.copy()
    holed[100] = np.nan
    guess = predict(truth, holed, u, 1)
    assert guess[100] == full[100]
    assert np.isfinite(guess[13:]).all()
    assert np.isnan(innovations(truth, holed, u)[100])


def test_frame_and_fit(truth, simulated):
    y, u = simulated(truth, 400, 2)
    frame = prediction_frame(truth, y, u)
    assert list(frame.columns) == ["measured", "predicted_1", "predicted_5", "predicted_10", "simulated"]
    assert fit_percent(y, y) == 100.0
    assert fit_percent(y, np.full(400, y.mean())) == pytest.approx(0.0)
    assert fit_percent(y, frame["predicted_1"]) > 95


def test_control_objects_are_the_same_system(truth, simulated):
    _, u = simulated(truth, 200, 3)
    expected = simulate(truth, u)
    import control

    for system in (truth.transfer_function(), truth.state_space()):
        assert system.dt == truth.sample_time
        assert control.forced_response(system, U=u[:, 0]).outputs == pytest.approx(expected, abs=1e-9)
    noise = truth.noise_transfer_function()
    assert control.impulse_response(noise, T=20).outputs == pytest.approx(
        lfilter(truth.c, truth.a, np.eye(1, 21)[0])
    )


def test_two_inputs_share_one_state_space():
    model = Armax(a=(1.0, -0.9), b=((1.0, 0.5), (2.0,)), nk=(0, 3), sample_time=0.01)
    import control

    u = np.random.default_rng(0).standard_normal((50, 2))
    assert control.forced_response(model.state_space(), U=u.T).outputs.ravel() == pytest.approx(
        simulate(model, u), abs=1e-9
    )


def test_wrong_calls_are_refused(truth, simulated):
    y, u = simulated(truth, 100, 0)
    with pytest.raises(InputError, match="steps"):
        predict(truth, y, u, 0)
    with pytest.raises(RecordingError, match="2 inputs"):
        predict(truth, y, np.hstack([u, u]))
    with pytest.raises(InputError, match="begin with 1"):
        Armax(a=(2.0, 1.0))
    with pytest.raises(InputError, match="not finite"):
        Armax(a=(1.0, float("nan")))
