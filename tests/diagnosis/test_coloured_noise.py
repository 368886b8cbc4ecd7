"""Coloured noise that no file states: told at the recordings' own rate, and followed from there."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import signal

from optid.core.recording import Channel, Recording
from optid.diagnosis import base_fit
from optid.diagnosis.problem import DiagnosisProblem, measurement_noise, prepare
from optid.diagnosis.validation import Validated, p_value
from optid.estimation.objective import objective_of
from optid.estimation.problem import build_problem
from optid.quality.noise import information_factor
from optid.rigs.rigfile import read_rig

DATA = Path(__file__).parents[2] / "data"
SAMPLES, SD, COLOUR = 20_000, 3e-5, 0.8
T = 1e-3 * np.arange(SAMPLES)


def motion(t):
    return 0.05 * np.sin(2 * np.pi * 0.3 * t)


def recorded(colour):
    white = np.random.default_rng(4).normal(size=SAMPLES)
    noise = SD * signal.lfilter([np.sqrt(1.0 - colour**2)], [1.0, -colour], white)
    channels = {
        "command": Channel("command", "u", "1", np.zeros(SAMPLES), held=True),
        "position": Channel("position", "x", "m", motion(T) + noise),
    }
    return Recording("noisy.csv", T, channels)


@pytest.fixture(scope="module")
def rig():
    return read_rig(DATA / "table1.toml")


def with_noise(rig, **known):
    return replace(rig, channels={**rig.channels, "position": replace(rig.channels["position"], **known)})


def test_colour_is_told_at_the_recordings_own_rate(rig):
    """By a third too much at this colour: curves follow slow noise as they follow motion."""
    own, _ = prepare(rig, [recorded(COLOUR)])
    told = own.channels["position"]
    assert 0.8 * SD < told.sd < 1.5 * SD and COLOUR - 0.05 < told.colour < COLOUR + 0.12


def test_what_hides_slow_motion_is_the_same_after_decimation(rig):
    _, (full,) = prepare(rig, [recorded(COLOUR)])
    slow, (half,) = prepare(with_noise(rig, sd=SD, colour=COLOUR), [full], 500.0)
    after = slow.channels["position"]
    assert len(half) < 0.6 * len(full) and after.colour == pytest.approx(COLOUR**2)
    left = half["position"].values - motion(half.time)
    means = left[: len(left) // 100 * 100].reshape(-1, 100).mean(axis=1)
    assert means.std() == pytest.approx(after.sd * np.sqrt(information_factor(after.colour) / 100), rel=0.2)
    assert left.std() == pytest.approx(after.sd, rel=0.1)


def test_a_fit_weighs_samples_by_what_was_told(rig):
    own = with_noise(rig, sd=SD, colour=0.3)  # not what these samples show
    objective, _ = objective_of(own, (), build_problem(own.model, [recorded(COLOUR)], 0.5))
    weight = objective.weight[0, [port.role for port in own.model.outputs].index("position")]
    assert 1.0 / weight == pytest.approx(SD * np.sqrt(information_factor(0.3)))


@pytest.mark.parametrize("at_noise", [True, False])
def test_a_base_at_the_noise_shows_its_colour_better_than_motion_does(rig, monkeypatch, at_noise):
    own, train = prepare(rig, [recorded(COLOUR)])
    problem = DiagnosisProblem(own, train, measurement_noise(own, train))
    search = problem.at_search_accuracy()
    outputs = [port.role for port in own.model.outputs]
    left = np.full((1, SAMPLES, len(outputs)), np.nan)
    left[0, :, outputs.index("position")] = train[0]["position"].values - motion(T)
    monkeypatch.setattr(base_fit, "quiet_filter", lambda *at: SimpleNamespace(innovations=left))
    base = SimpleNamespace(p=None, fit=SimpleNamespace(level=None))
    monkeypatch.setattr(base_fit, "is_at_noise", lambda model, problem: at_noise)
    told = base_fit.with_residual_noise(problem, base, search)
    channel, before = told.rig.channels["position"], own.channels["position"]
    if not at_noise:
        assert channel == before
        return
    assert told.noise["position"] == channel.sd
    # As much slow motion is hidden as truly is, which motion had let look like more.
    true = SD**2 * information_factor(COLOUR)
    found, said = (one.sd**2 * information_factor(one.colour) for one in (channel, before))
    assert 0.5 * true < found < 2.0 * true < said


def test_a_slow_sensor_in_a_faster_log_keeps_its_noise(rig, monkeypatch):
    """Between its values there are none: no two neighbours are known."""
    own, train = prepare(with_noise(rig, sd=2.0 * SD, colour=0.3), [recorded(0.0)])
    problem = DiagnosisProblem(own, train, measurement_noise(own, train))
    outputs = [port.role for port in own.model.outputs]
    left = np.full((1, SAMPLES, len(outputs)), np.nan)
    left[0, ::4, outputs.index("position")] = (train[0]["position"].values - motion(T))[::4]
    monkeypatch.setattr(base_fit, "is_at_noise", lambda model, problem: True)
    monkeypatch.setattr(base_fit, "quiet_filter", lambda *at: SimpleNamespace(innovations=left))
    base = SimpleNamespace(p=None, fit=SimpleNamespace(level=None))
    told = base_fit.with_residual_noise(problem, base, problem).rig.channels["position"]
    assert told.sd == pytest.approx(SD, rel=0.1) and 0.0 <= told.colour < 0.1


def test_white_noise_stays_white_and_a_stated_one_stays_stated(rig):
    own, train = prepare(rig, [recorded(0.0)])
    assert own.channels["position"].sd is None and own.channels["position"].colour == 0.0
    assert prepare(own, train, 500.0)[0].channels["position"].colour == 0.0
    stated, _ = prepare(with_noise(rig, sd=SD), [recorded(COLOUR)])
    assert stated.channels["position"].sd == SD and stated.channels["position"].colour is None


def test_errors_are_compared_with_the_noise_and_gains_with_what_it_hides():
    white, coloured = (Validated(np.full((20, 1), 4.0), factor) for factor in (1.0, 9.0))
    assert white.error_over_noise == coloured.error_over_noise == 2.0
    after = np.full(20, 0.5)
    assert coloured.windows == pytest.approx(white.windows / 9.0)
    p = [p_value(one.windows, after / factor, True) for one, factor in ((white, 1.0), (coloured, 9.0))]
    assert p[0] < p[1]


@pytest.mark.parametrize(("fault", "kept"), [("outliers", False), ("drift", True)])
def test_neither_outliers_nor_slow_errors_pass_for_noise(rig, monkeypatch, fault, kept):
    own, train = prepare(rig, [recorded(COLOUR)])
    problem = DiagnosisProblem(own, train, measurement_noise(own, train))
    outputs = [port.role for port in own.model.outputs]
    noise = train[0]["position"].values - motion(T)
    noise = (
        noise + np.where(np.arange(SAMPLES) % 500 == 7, 1.0, 0.0)
        if fault == "outliers"
        else 50.0 * SD * np.sin(T)
    )
    left = np.full((1, SAMPLES, len(outputs)), np.nan)
    left[0, :, outputs.index("position")] = noise
    monkeypatch.setattr(base_fit, "is_at_noise", lambda model, problem: True)
    monkeypatch.setattr(base_fit, "quiet_filter", lambda *at: SimpleNamespace(innovations=left))
    base = SimpleNamespace(p=None, fit=SimpleNamespace(level=None))
    told = base_fit.with_residual_noise(problem, base, problem).rig.channels["position"]
    if kept:
        assert told == own.channels["position"]
    else:
        assert told.sd == pytest.approx(SD, rel=0.15) and told.colour == pytest.approx(COLOUR, abs=0.1)
