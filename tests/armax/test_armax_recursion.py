"""The recursion against truth, against batch estimates, and against everything that may go wrong on a rig."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from optid.armax import (
    Armax,
    Constant,
    Directional,
    Identifier,
    Method,
    Orders,
    Settings,
    Variable,
    exact_start,
    identify,
)
from optid.armax.batch import fit_batch
from optid.armax.prediction import predict
from optid.armax.regression import least_squares
from optid.armax.signals import signals
from optid.errors import InputError, NotIdentifiable, RecordingError

ELS = Settings(method=Method.EXTENDED_LEAST_SQUARES)
LAWS = [Constant(0.99), Variable(300.0, 0.9), Directional(0.99)]


def relative_error(model: Armax, truth: Armax) -> float:
    return float(np.linalg.norm(model.theta - truth.theta) / np.linalg.norm(truth.theta))


@pytest.mark.parametrize("settings", [Settings(), ELS], ids=["likelihood", "extended"])
def test_known_truth_is_found(truth, simulated, settings):
    errors = []
    for seed in range(12):
        y, u = simulated(truth, 4001, seed)
        errors.append(relative_error(identify(y, u, truth.orders, settings=settings).model, truth))
    assert np.median(errors) < 0.013
    assert max(errors) < 0.05


def test_noise_variance_is_found(truth, simulated):
    y, u = simulated(truth, 20_000, 3)
    assert identify(y, u, truth.orders).model.noise_variance == pytest.approx(0.01, rel=0.05)


ARX = Armax(a=(1.0, -1.2, 0.5), b=((1.0, 0.4),), nk=(2,), noise_variance=0.04)
ARX2 = Armax(a=(1.0, -1.2, 0.5), b=((1.0, 0.4), (0.3,)), nk=(1, 3), noise_variance=0.04)


@pytest.mark.parametrize("system", [ARX, ARX2], ids=["one input", "two inputs"])
@pytest.mark.parametrize("holes", [False, True])
def test_exact_start_gives_batch_least_squares(simulated, system, holes):
    y, u = simulated(system, 1500, 1)
    if holes:
        y[[200, 201, 700]] = np.nan
        u[400, 0] = np.nan
    identifier = Identifier(system.orders, scales=signals(y, u).scales)
    used = exact_start(identifier, y, u)
    assert used < 50
    identifier.run(y[used:], u[used:])
    batch = least_squares([signals(y, u)], system.orders)
    assert identifier.theta == pytest.approx(batch, abs=1e-10)


def test_exact_start_refuses_a_silent_input(simulated):
    y, u = simulated(ARX, 300, 1)
    with pytest.raises(NotIdentifiable, match="does not determine"):
        exact_start(Identifier(ARX.orders), y, np.zeros_like(u))


def test_likelihood_tends_to_the_batch_estimate(truth, simulated):
    """The distance shrinks with the recording, and ends well below what the noise leaves open."""
    distances = []
    for N in (4000, 40_000):
        apart = []
        for seed in range(3):
            y, u = simulated(truth, N, seed)
            batch = fit_batch([(y, u)], truth.orders).model
            gap = (identify(y, u, truth.orders).model.theta - batch.theta) / batch.standard_errors
            apart.append(np.sqrt(np.mean(gap**2)))
        distances.append(np.mean(apart))
    assert distances[1] < 0.2
    assert distances[1] < 0.7 * distances[0]


def test_covariance_tells_the_scatter(truth, simulated):
    scores = []
    for seed in range(12):
        y, u = simulated(truth, 4001, seed)
        model = identify(y, u, truth.orders).model
        scores.append((model.theta - truth.theta) / model.standard_errors)
    assert 0.6 < np.sqrt(np.mean(np.square(scores))) < 1.5


def test_arma_without_input(simulated):
    system = Armax(a=(1.0, -0.8), c=(1.0, 0.5), noise_variance=1.0)
    y, _ = simulated(system, 20_000, 0)
    model = identify(y, None, Orders(1, nc=1)).model
    assert model.theta == pytest.approx([-0.8, 0.5], abs=0.03)


def test_two_inputs_with_their_own_delays(simulated):
    system = Armax(a=(1.0, -0.9), b=((1.0, 0.5), (-2.0,)), c=(1.0, 0.4), nk=(1, 4), noise_variance=0.01)
    y, u = simulated(system, 6000, 5, switch=0.3)
    model = identify(y, u, system.orders).model
    assert model.theta == pytest.approx(system.theta, abs=0.03)
    assert model.orders == system.orders


def test_one_sample_at_a_time_is_the_whole_recording(truth, simulated):
    y, u = simulated(truth, 800, 2)
    whole, single = Identifier(truth.orders), Identifier(truth.orders)
    innovations, _ = whole.run(y, u)
    stepped = [single.step(a, b) for a, b in zip(y.tolist(), u[:, 0].tolist(), strict=True)]
    assert np.array_equal(innovations, stepped)
    assert np.array_equal(whole.state, single.state)


def test_many_inputs_step(simulated):
    y, u = simulated(ARX2, 300, 2)
    whole, single = Identifier(ARX2.orders), Identifier(ARX2.orders)
    whole.run(y, u)
    for a, b in zip(y.tolist(), u, strict=True):
        single.step(a, b)
    assert np.array_equal(whole.state, single.state)


@pytest.mark.full
def test_tailored_kernels_give_the_same_bits(simulated):
    system = Armax(a=(1.0, -1.2, 0.5), b=((1.0, 0.4),), c=(1.0, 0.4, 0.1), nk=(1,), noise_variance=0.04)
    y, u = simulated(system, 600, 3, switch=0.3)
    y[[100, 101, 300]] = np.nan
    u[200, 0] = np.nan
    settings = Settings(forgetting=Constant(0.99), outliers=4.0)
    usual, own = (Identifier(system.orders, settings=settings, tailored=t) for t in (False, True))
    expected, found = (identifier.run(y[:500], u[:500])[0] for identifier in (usual, own))
    assert np.array_equal(expected, found, equal_nan=True)
    for a, b in zip(y[500:].tolist(), u[500:, 0].tolist(), strict=True):
        assert usual.step(a, b) == own.step(a, b)
    assert np.array_equal(usual.state, own.state, equal_nan=True)


def test_saved_memory_of_another_model_is_refused(truth):
    with pytest.raises(InputError, match="state of another model"):
        Identifier(truth.orders).restored(Identifier(Orders.of(2, 2, 1)).state)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_forgetting_follows_a_change(simulated, law):
    before = Armax(a=(1.0, -0.9), b=((1.0,),), nk=(1,), noise_variance=1e-4)
    after = Armax(a=(1.0, -0.5), b=((2.0,),), nk=(1,), noise_variance=1e-4)
    parts = [simulated(system, 3000, 4, switch=0.3) for system in (before, after)]
    y, u = (np.concatenate(x) for x in zip(*parts, strict=True))
    forgetful = identify(y, u, before.orders, settings=Settings(forgetting=law)).model
    stubborn = identify(y, u, before.orders, settings=Settings(forgetting=Constant(1.0))).model
    assert forgetful.theta == pytest.approx(after.theta, abs=0.05)
    assert np.max(np.abs(stubborn.theta - after.theta)) > 0.1


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
@pytest.mark.parametrize("idle", ["rest", "held", "hum"])
def test_idling_does_not_wind_up(law, idle):
    """All of the 10^7 idle samples run in studies/benchmark_armax.py; the trace settles long before."""
    system = Armax(a=(1.0, -1.5, 0.7), b=((1.0, 0.5),), nk=(1,))
    first, N, last = 2000, 100_000, 50
    rng = np.random.default_rng(0)
    u = np.where(np.cumsum(rng.random(first + N + last) < 0.3) % 2, 1.0, -1.0)
    e = 1e-3 * rng.standard_normal(u.size)
    u[first : first + N] = 1.0 if idle == "held" else 0.0
    if idle != "hum":
        e[first : first + N] = 0.0
    y = lfilter([0.0, *system.b[0]], system.a, u) + lfilter([1.0], system.a, e)
    chosen = Settings(forgetting=law, noise=1e-3)
    identifier = Identifier(system.orders, settings=chosen)
    identifier.run(y[: first + N], u[: first + N])
    limit = chosen.start_variances(system.orders).sum()
    assert np.trace(identifier.scaled_covariance) <= limit * 1.0001
    identifier.run(y[first + N :], u[first + N :])
    assert identifier.theta == pytest.approx(system.theta, rel=0.05)


LONG = [Constant(1.0), Constant(0.9998), Variable(10_000.0, 0.9), Directional(0.9998)]


@pytest.mark.parametrize("law", LONG, ids=str)
@pytest.mark.parametrize("idle", ["rest", "held", "hum"])
def test_a_noise_model_survives_idling(law, idle):
    """C was learnt from 20000 samples; nothing tells of it at rest, and 50 rich samples could not teach it."""
    system = Armax(a=(1.0, -1.5, 0.7), b=((1.0, 0.5),), c=(1.0, 0.5), nk=(1,))
    first, N, last = 20_000, 100_000, 50
    rng = np.random.default_rng(0)
    u = np.where(np.cumsum(rng.random(first + N + last) < 0.3) % 2, 1.0, -1.0)
    e = 1e-3 * rng.standard_normal(u.size)
    u[first : first + N] = 1.0 if idle == "held" else 0.0
    if idle != "hum":
        e[first : first + N] = 0.0
    y = lfilter([0.0, *system.b[0]], system.a, u) + lfilter(system.c, system.a, e)
    identifier = Identifier(system.orders, settings=Settings(forgetting=law, noise=1e-3))
    identifier.run(y, u)
    assert identifier.theta == pytest.approx(system.theta, rel=0.05)


def test_a_noise_model_waits_for_the_rest():
    """Innovations of the first samples, a thousand times the noise, must not pass for noise."""
    system = Armax(a=(1.0, -1.5, 0.7), b=((1.0, 0.5),), c=(1.0, 0.5), nk=(1,))
    rng = np.random.default_rng(0)
    u = np.where(np.cumsum(rng.random(5000) < 0.3) % 2, 1.0, -1.0)
    y = lfilter([0.0, 1.0, 0.5], system.a, u) + lfilter(system.c, system.a, 1e-3 * rng.standard_normal(5000))
    errors = []
    for patience in (10.0, 0.0):
        identifier = Identifier(system.orders, settings=Settings(noise=1e-3, patience=patience))
        identifier.run(y, u)
        errors.append(abs(identifier.theta[4] - 0.5))
    assert errors[0] < 0.04  # three standard errors of 5000 samples
    assert errors[1] > 0.15


def test_rest_says_nothing_about_the_noise(simulated):
    """A position that stands still in its last digit: the standard errors must not shrink."""
    identifier = Identifier(ARX.orders, settings=Settings(forgetting=Constant(0.99)))
    identifier.run(*simulated(ARX, 5000, 0))
    before = identifier.noise_variance
    assert before == pytest.approx(0.04, rel=0.5)
    identifier.run(np.zeros(100_000), np.zeros(100_000))
    assert identifier.noise_variance > 0.5 * before


def test_without_the_limit_it_would_wind_up():
    """A noisy output at rest keeps the forgetting going, and the input's coefficients have no news."""
    y = 1e-3 * np.random.default_rng(0).standard_normal(20_000)
    traces = []
    for limit in (None, 1e30):
        settings = Settings(forgetting=Constant(0.99), variance_limit=limit)
        identifier = Identifier(Orders.of(4, 2, 0), settings=settings)
        identifier.run(y, np.zeros(y.size))
        traces.append(np.trace(identifier.scaled_covariance))
    assert traces[0] < 1e7
    assert traces[1] > 1e20


def test_at_rest_nothing_fades(simulated):
    identifier = Identifier(ARX.orders, settings=Settings(forgetting=Constant(0.99)))
    identifier.run(*simulated(ARX, 1000, 0))
    identifier.run(np.zeros(10), np.zeros(10))
    before = np.trace(identifier.scaled_covariance)
    identifier.run(np.zeros(100_000), np.zeros(100_000))
    assert np.trace(identifier.scaled_covariance) <= before


def test_an_outlier_moves_little(simulated):
    y, u = simulated(ARX, 1000, 7)
    moves = []
    for bound in (None, 4.0):
        identifier = Identifier(ARX.orders, settings=Settings(outliers=bound, forgetting=Constant(0.99)))
        identifier.run(y, u)
        before = identifier.theta
        identifier.step(1e4, 1.0)
        moves.append(np.linalg.norm(identifier.theta - before))
    assert identifier.counts.outliers > 0
    assert moves[1] < 0.02 < moves[0]


def test_c_stays_stable(simulated):
    system = Armax(a=(1.0, -0.9), b=((1.0,),), c=(1.0, 1.6, 0.8), nk=(1,), noise_variance=1.0)
    y, u = simulated(system, 3000, 0)
    y[500:520] *= 30.0
    identifier = Identifier(system.orders, settings=Settings(forgetting=Constant(0.95), ease=None))
    for a, b in zip(y.tolist(), u[:, 0].tolist(), strict=True):
        identifier.step(a, b)
        assert np.all(np.abs(np.roots([1.0, *identifier.theta[-2:]])) < 1.0)
    assert identifier.counts.projections > 0


def test_missing_samples_are_skipped(truth, simulated):
    y, u = simulated(truth, 8000, 1)
    lost = np.random.default_rng(0).random(y.size) < 0.02
    y[lost] = np.nan
    result = identify(y, u, truth.orders)
    assert relative_error(result.model, truth) < 0.02
    assert result.counts.missing == lost.sum()
    assert np.array_equal(np.isnan(result.innovations), lost)
    assert result.counts.learnt_from < 8000 - 3 * lost.sum()


def test_prediction_of_the_identifier_is_the_model_s(truth, simulated):
    y, u = simulated(truth, 3000, 1)
    identifier = Identifier(truth.orders, settings=Settings(start_sd=1e-9, start_sd_c=1e-9))
    identifier.start_at(truth.theta)
    identifier.run(y[:2990], u[:2990])
    ahead = identifier.predict(10, u[2990:])
    last = [predict(truth, y[: 2990 + k], u[: 2990 + k], k)[-1] for k in range(1, 11)]
    assert ahead == pytest.approx(last, abs=1e-6)


def test_frame_of_the_track(truth, simulated):
    y, u = simulated(truth, 1000, 1)
    frame = identify(y, u, truth.orders, 0.01, every=100).frame()
    assert list(frame.columns) == ["a1", "a2", "a3", "a4", "b0", "b1", "b2", "c1", "c2"]
    assert frame.index[-1] == pytest.approx(10.0)


def test_errors_say_what_to_do():
    with pytest.raises(InputError, match="nk: -1"):
        Orders.of(2, 2, 0, -1)
    with pytest.raises(InputError, match="forgetting factor"):
        Identifier(Orders.of(1, 1, 0), settings=Settings(forgetting=Constant(1.5)))
    with pytest.raises(InputError, match="radius"):
        Settings(radius=2.0)
    with pytest.raises(RecordingError, match="2 inputs"):
        identify(np.zeros(100), np.zeros((100, 2)), Orders.of(1, 1, 0))
    with pytest.raises(RecordingError, match="shapes"):
        identify(np.zeros(100), np.zeros(99), Orders.of(1, 1, 0))
    with pytest.raises(NotIdentifiable, match="cannot determine"):
        identify(np.zeros(5), np.zeros(5), Orders.of(4, 4, 4))
    with pytest.raises(InputError, match="scales"):
        Identifier(Orders.of(1, 1, 0), scales=(0.0, [1.0]))
