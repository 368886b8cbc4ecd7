"""Noise and value grid against signals whose noise and grid are known."""

import math

import numpy as np
import pytest
from scipy import signal

from optid.quality.noise import colour, grid, noise_sd, quietest, thinned_noise

T = np.arange(8000) * 1e-3
MOTION = 0.1 * np.sin(2 * np.pi * 1.3 * T) + 0.02 * np.sin(2 * np.pi * 9 * T)


@pytest.mark.parametrize("sd", [1e-6, 3e-5, 1e-3])
@pytest.mark.parametrize("seed", range(3))
def test_noise_is_seen_through_motion(sd, seed):
    rng = np.random.default_rng(seed)
    # 8000 samples give the median of differences to about 2 %, correlated as they are.
    found = noise_sd(MOTION + rng.normal(0, sd, T.size))
    # What curves leave of this motion in its quietest stretches may pass for 2.6 um of noise with a long memory.
    assert 0.93 * sd < found < 1.07 * math.hypot(sd, 2.6e-6)


def test_motion_that_curves_do_not_follow_has_no_colour():
    assert colour(MOTION) == 0.0 and quietest(MOTION)[0] < 1e-6


def test_outliers_and_missing_samples_do_little():
    rng = np.random.default_rng(1)
    values = MOTION + rng.normal(0, 3e-5, T.size)
    values[rng.integers(0, T.size, 80)] += 0.05
    values[rng.integers(0, T.size, 400)] = np.nan
    assert noise_sd(values) == pytest.approx(3e-5, rel=0.15)


@pytest.mark.parametrize("steps", [0.2, 0.5, 1.0, 3.0])
def test_quantisation_adds_its_own_error(steps):
    """Noise of sd on a grid of steps*sd: rounding adds step^2/12 to the variance (Widrow)."""
    rng = np.random.default_rng(2)
    sd, step = 3e-5, 3e-5 * steps
    values = np.round((MOTION + rng.normal(0, sd, T.size)) / step) * step
    assert noise_sd(values) == pytest.approx(math.hypot(sd, step / math.sqrt(12)), rel=0.12)


def test_a_resting_quantised_signal_still_errs_by_rounding():
    values = np.round(np.where(T < 4, MOTION, MOTION[4000]) / 1e-3) * 1e-3
    assert noise_sd(values) >= 1e-3 / math.sqrt(12)


@pytest.mark.parametrize("share", [0.0, 0.16, 0.2])
def test_noise_below_the_grid_shows_in_fast_motion(share):
    """At rest neither rounding nor so little noise shows; where it moves by steps from sample to sample, both do."""
    rng = np.random.default_rng(4)
    step = 6e-5
    rests = np.where(T < 1.5, MOTION, MOTION[1500])
    found = noise_sd(np.round((rests + rng.normal(0, share * step, T.size)) / step) * step)
    true = step * math.hypot(share, 1 / math.sqrt(12))
    assert 0.97 * true < found < 1.15 * true
    assert found < step * math.hypot(0.25, 1 / math.sqrt(12)) + 1e-12  # more would have shown at rest


def test_short_and_empty_signals_have_no_noise():
    assert noise_sd(np.zeros(3)) == noise_sd(np.full(100, np.nan)) == 0.0


@pytest.mark.parametrize("step", [1e-7, 0.204248, 5.0])
def test_grid_is_found_with_sparse_levels(step):
    levels = np.random.default_rng(3).integers(-2000, 2000, 3000)
    levels[:2] = [0, 1]
    assert grid(levels * step + 7 * step) == pytest.approx(step, rel=1e-9)


def test_grid_survives_decimals_cut_off():
    levels = np.random.default_rng(4).integers(0, 600, 5000)
    assert grid(np.round(levels * 0.204248, 4)) == pytest.approx(0.204248, rel=1e-3)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("size", [20, 1000])
def test_continuous_values_have_no_grid(seed, size):
    assert grid(np.random.default_rng(seed).normal(size=size)) == 0.0


def test_a_switch_is_no_grid():
    assert grid(np.tile([0.0, 1.0, 2.0], 100)) == 0.0


def filtered_noise(correlation, seed, sd=3e-5):
    white = np.random.default_rng(seed).normal(0, sd, T.size)
    return signal.lfilter([np.sqrt(1 - correlation**2)], [1, -correlation], white)


@pytest.mark.parametrize("correlation", [0.0, 0.3, 0.5])
@pytest.mark.parametrize("seed", range(3))
def test_filtered_noise_is_seen_whole_and_its_colour_told(correlation, seed):
    """Over 60 seeds the colour found has a scatter of 0.03 to 0.05, the standard deviation one of 2 to 5 %."""
    values = MOTION + filtered_noise(correlation, seed)
    assert noise_sd(values) == pytest.approx(3e-5, rel=0.15)
    assert colour(values) == pytest.approx(correlation, abs=0.2 if correlation else 1e-9)


def test_noise_with_a_long_memory_is_told_from_white():
    assert colour(MOTION + filtered_noise(0.8, 1)) > 0.6


def test_a_resting_quantised_signal_has_no_colour():
    assert colour(np.round(MOTION / 1e-3) * 1e-3) == 0.0


def resonance(period):
    """Two neighbouring sinusoids that beat, as a lightly damped axis does: about `period` samples a cycle, sd 1."""
    k = np.arange(4000)
    return np.sin(2 * np.pi * k / period) + np.sin(2 * np.pi * k / (1.07 * period))


@pytest.mark.parametrize("period", [9, 18, 36])
@pytest.mark.parametrize("sd", [1e-4, 1e-2])
def test_a_resonance_is_not_taken_for_noise(period, sd):
    """Neither curves over 48 samples nor differences follow what swings every nine of them."""
    values = resonance(period) + np.random.default_rng(6).normal(0, sd, 4000)
    assert quietest(values) == (0.0, 0.0)
    assert 0.9 * sd < noise_sd(values) < 1.15 * sd


def test_a_swing_without_noise_has_next_to_none():
    assert noise_sd(resonance(9)) < 1e-9
    assert noise_sd(resonance(36)) < 1e-9


def test_outliers_do_not_hide_how_little_noise_a_resonance_has():
    rng = np.random.default_rng(7)
    values = resonance(36) + rng.normal(0, 1e-3, 4000)
    values[rng.integers(0, 4000, 8)] += 0.3
    assert noise_sd(values) < 5e-3  # the differences' size


def test_a_stated_noise_falls_with_what_is_seen_of_it():
    rng = np.random.default_rng(8)
    values = MOTION + rng.normal(0, 3e-5, T.size)
    averaged = values.reshape(-1, 4).mean(axis=1)
    assert thinned_noise(5e-5, values, averaged) == pytest.approx(2.5e-5, rel=0.1)


@pytest.mark.parametrize(("steps", "least", "most"), [(0.1, 0.8, 1.2), (8.0, 0.1, 0.5)])
def test_rounding_averages_out_only_where_the_signal_moves_over_its_grid(steps, least, most):
    """So many steps over what is averaged at most; an encoder that rests within a step errs by it as before."""
    step, count = 25e-6, 10
    k = np.arange(20000)
    true = 300.0 * step * np.sin(k * steps / count / 300.0) + 0.1 * step * np.sin(0.37 * k)
    values = np.round(true / step) * step
    averaged, mean = values.reshape(-1, count).mean(axis=1), true.reshape(-1, count).mean(axis=1)
    found = thinned_noise(noise_sd(values), values, averaged)
    assert least < found / (step / math.sqrt(12)) < most
    assert float(np.sqrt(np.mean((averaged - mean) ** 2))) < 1.2 * found
    assert steps > 1.0 or noise_sd(averaged) < 0.5 * found  # where the samples alone do not show it
