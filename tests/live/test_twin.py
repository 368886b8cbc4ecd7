"""The model beside the rig: the numbers of a simulation; an observer that stays with a rig it does not know."""

import numpy as np
import pandas as pd
import pytest

from optid.core.readers import read_recording
from optid.core.simulation import simulate
from optid.live.observer import Observer
from optid.live.twin import Twin

INDEX = 0  # of the position among the outputs


@pytest.fixture
def record(bench):
    return read_recording(bench.path.with_name("bench.csv"), bench)


def test_a_twin_is_the_simulation_sample_by_sample(bench, record):
    p = bench.model.vector(bench.parameters)
    n = 2000
    command, span = record["command"].values, np.diff(record.time)
    start = np.asarray(bench.model.start(p)[0], dtype=float).ravel()
    truth = simulate(bench.model, p, start[None], np.r_[span, span[-1]], command[:, None])
    twin = Twin(bench.model, p, start)
    shown = [twin.outputs()[INDEX]]
    for k in range(n - 1):
        assert twin.advance(command[k], span[k])
        shown.append(twin.outputs()[INDEX])
    assert np.max(np.abs(np.array(shown) - truth.outputs[0, :n, INDEX])) < 2e-6  # m


def test_a_copy_goes_on_alike(bench):
    p = bench.model.vector(bench.parameters)
    first, second = Twin(bench.model, p), Twin(bench.model, p)
    for k in range(200):
        first.advance(np.sin(0.03 * k), 1e-3)
    second.copy(first)
    assert second.outputs().tolist() == first.outputs().tolist()
    for _ in range(50):
        first.advance(0.3, 1e-3)
        second.advance(0.3, 1e-3)
    np.testing.assert_allclose(second.outputs(), first.outputs(), rtol=1e-5)


def test_nonsense_starts_the_twin_anew(bench):
    twin = Twin(bench.model, bench.model.vector(bench.parameters))
    at_rest = twin.outputs().copy()
    twin.advance(1.0, 0.05)
    assert not twin.advance(np.nan, 1e-3)
    assert twin.outputs().tolist() == at_rest.tolist()
    assert twin.advance(0.1, 1e-3)


def observed(bench, record, noise, measured):
    observer = Observer(bench.model, bench.model.vector(bench.parameters), noise)
    shown = np.empty(len(measured))
    y = np.full(len(noise), np.nan)
    command, span = record["command"].values, np.diff(record.time)
    for k in range(len(measured)):
        if k:
            observer.advance(command[k - 1], span[k - 1])
        shown[k] = observer.outputs()[INDEX]
        y[INDEX] = measured[k]
        observer.correct(y)
    return observer, shown


def test_the_observer_stays_with_a_rig_whose_parameters_it_does_not_know(bench, record):
    measured = record["position"].values[:6000]
    unknown = np.full(len(bench.model.outputs), np.nan)
    observer, shown = observed(bench, record, unknown, measured)
    error = (measured - shown)[1000:]
    assert np.sqrt(np.mean(error**2)) < 5e-4  # one sample ahead; the rig moves by centimetres
    assert 5e-6 < observer.noise[INDEX] < 1e-4  # bench_truth.json: 20 micrometres


def test_one_outlier_hardly_moves_it(bench, record):
    measured = record["position"].values[:1500].copy()
    noise = np.full(len(bench.model.outputs), 3e-5)
    _, clean = observed(bench, record, noise, measured)
    measured[1200] += 0.05
    _, hit = observed(bench, record, noise, measured)
    assert np.max(np.abs(hit - clean)) < 1e-3


def test_missing_samples_are_bridged(bench, record):
    measured = record["position"].values[:2000].copy()
    measured[1500:1520] = np.nan
    noise = np.full(len(bench.model.outputs), 3e-5)
    _, shown = observed(bench, record, noise, measured)
    assert np.isfinite(shown).all()
    late = slice(1600, 2000)
    assert np.nanmax(np.abs(measured - shown)[late]) < 5e-3


def test_a_wrong_model_is_noticed_after_a_while_and_agreement_too():
    from optid.live.mismatch_monitor import PATIENCE, MismatchMonitor

    judge, rng = MismatchMonitor(1e-3), np.random.default_rng(0)
    y = 0.05 * np.sin(2 * np.pi * 0.5 * np.arange(60_000) * 1e-3)
    verdicts = []
    for k, value in enumerate(y):
        off = 0.01 if 15_000 <= k < 30_000 else 0.0
        judge.add(value, value + off + 1e-5 * rng.standard_normal(), 1e-5)
        verdicts.append(judge.verdict.disagree)
    first = verdicts.index(True)
    assert 15_000 + 1e3 * PATIENCE <= first < 28_000
    assert not any(verdicts[:first])
    judge.add(np.nan, 0.0, 1e-5)  # says nothing
    assert np.isfinite(judge.fit_percent)


def test_noise_alone_is_no_mismatch():
    from optid.live.mismatch_monitor import MismatchMonitor

    judge, rng = MismatchMonitor(1e-3), np.random.default_rng(0)
    for e in 1e-5 * rng.standard_normal(30_000):  # a rig at rest: the fit is far below any share
        judge.add(e, 0.0, 1e-5)
    assert judge.fit_percent < 10
    assert not judge.verdict.disagree


def test_the_frame_of_a_session_holds_the_observers_windows(bench, run_live):
    _, loop, path = run_live(bench, seconds=6.0)
    log = pd.read_csv(path)
    error = (log["x"] - log["x_windowed"]).abs()
    starts = log["t"].between(0.5, 6.0) & (log["t"] % 0.5 < 1e-6)
    assert error[starts].max() < 1.0  # mm: a window starts where the rig is
    assert loop.parallel.monitor.fit_percent == pytest.approx(
        100 * (1 - error.pow(2).mean() ** 0.5 / log["x"].std()), abs=8
    )
