"""Faults that are put right beyond doubt, each told; what only looks like one stays as it is."""

import numpy as np
import pytest

from optid.core.readers.own_rate import held_between
from optid.core.readers.repair import repaired

N = 4000
RNG = np.random.default_rng(0)
TIME = np.arange(N) * 1e-3
SMOOTH = 80.0 * np.sin(3 * TIME) + 30.0 * np.sin(7 * TIME)


def position(noise=0.003):
    return SMOOTH + np.random.default_rng(1).normal(0, noise, N)


def put_right(series):
    values, repairs = repaired({"position": series}, {"position": False})
    return values["position"], [repair.message for repair in repairs]


@pytest.mark.parametrize("signed", [True, False])
@pytest.mark.parametrize(
    ("modulus", "grid"), [(65.536, 0.001), (40.96, 0.01), (360.0, 0.1), (100.3, 0.0)], ids=str
)
def test_wrapped_counters_are_unwrapped(modulus, grid, signed):
    true = 2.0 * position()
    true = np.round(true / grid) * grid if grid else true
    wrapped = np.mod(true + (modulus / 2 if signed else 0), modulus) - (modulus / 2 if signed else 0)
    found, (message,) = put_right(wrapped)
    assert "wraps" in message
    offset = found[0] - true[0]
    np.testing.assert_allclose(found - offset, true, atol=0.02 if not grid else 1e-6)


@pytest.mark.parametrize("value", [0.0, -999.0, 32767.0, 1e5])
def test_values_that_stand_in_for_lost_samples_are_missing(value):
    series = position() + 200.0
    at = np.random.default_rng(2).choice(N - 10, 20, replace=False)
    lost = np.zeros(N, dtype=bool)
    for k in at:
        lost[k : k + 1 + k % 3] = True
    series[lost] = value
    found, (message,) = put_right(series)
    assert np.array_equal(np.isnan(found), lost)
    assert f"exactly {value:.6g}" in message


def test_absurd_readings_are_missing():
    series = position()
    series[[5, 1000, 1001]] = [-1e70, 9.91e37, 1e300]
    found, (message,) = put_right(series)
    assert np.flatnonzero(np.isnan(found)).tolist() == [5, 1000, 1001]
    assert "3 such samples" in message


@pytest.mark.parametrize("every", [2, 4, 16])
def test_repeats_of_a_slower_sensor_are_not_counted(every):
    found, (message,) = put_right(np.repeat(position()[::every], every)[:N])
    assert np.flatnonzero(np.isfinite(found)).tolist() == [0, *range(every, N, every)]
    assert f"every {every}" in message


@pytest.mark.parametrize("ratio", [1.4, 2.5, 3.5])
def test_repeats_at_a_ratio_that_is_no_whole_number(ratio):
    rows = (np.floor(np.arange(N) / ratio + 1e-9) * ratio).astype(int)
    found, (message,) = put_right(position()[rows])
    assert f"every {ratio}th row" in message
    changes = np.flatnonzero(np.diff(rows)) + 1
    assert np.flatnonzero(np.isfinite(found)).tolist() == [0, *changes]


@pytest.mark.parametrize("grid", [0.0, 1e-4])
def test_samples_that_a_logger_interpolated_are_not_counted(grid):
    series = np.interp(np.arange(N), np.arange(0, N, 4), position()[::4])
    series = np.round(series / grid) * grid if grid else series
    found, (message,) = put_right(series)
    assert "runs in straight lines between every 4th row" in message
    assert np.flatnonzero(np.isfinite(found)).tolist() == list(range(0, N, 4))


def test_absurd_readings_may_be_many_but_not_next_to_rounding():
    series = position()
    series[1000:2500] = -1e70
    found, (message,) = put_right(series)
    assert np.isnan(found[1000:2500]).all()
    assert "1500 such samples" in message
    rest = 1e-12 * np.random.default_rng(0).normal(size=N)
    rest[1000:2500] = 10 * np.sin(np.linspace(0, np.pi, 1500))  # a move beside the rounding of zero
    np.testing.assert_array_equal(put_right(rest)[0], rest)


SOUND = {
    "a sensor with noise": position(),
    "a coarse grid": np.round(position() / 0.5) * 0.5,
    "a fine ramp on a grid": np.round(np.linspace(0, 40, N) / 0.1) * 0.1,
    "rest, then a jump of the setpoint": np.r_[np.zeros(2000), 5 + np.zeros(2000)] + RNG.normal(0, 0.003, N),
    "a triangle with noise": 40 * np.abs((TIME % 0.4) / 0.2 - 1) + RNG.normal(0, 0.003, N),
    "on and off": 3.0 * (np.sin(40 * TIME) > 0) + RNG.normal(0, 0.003, N),
    "pulses on a rest": np.where(np.arange(N) % 500 < 8, 50.0, 0.0),
    "steps between levels": np.repeat(RNG.normal(0, 10, 20), 200),
    "a signal at rest at zero between strokes": np.where(np.sin(2 * TIME) > 0, 50 * np.sin(2 * TIME), 0.0),
}


@pytest.mark.parametrize("name", SOUND)
def test_sound_signals_stay_as_they_are(name):
    found, messages = put_right(SOUND[name])
    assert messages == []
    np.testing.assert_array_equal(found, SOUND[name])


def test_a_slow_command_is_held_over_its_own_interval_only():
    command = np.full(N, np.nan)
    command[::10] = np.arange(N // 10)
    command[1000:2000] = np.nan
    found, (note,) = held_between(TIME, {"command": command}, {"command": True})
    assert "every 10 rows (100 Hz)" in note
    assert found["command"][:1000].tolist() == np.repeat(np.arange(100), 10).tolist()
    assert np.isnan(found["command"][1010:2000]).all()


def test_a_command_is_held_in_the_rows_of_another_logger():
    """Two loggers joined over time, with clocks that never meet: every fifth command is followed by a position."""
    time = np.sort(np.r_[np.arange(400) * 0.01, np.arange(80) * 0.05 + 0.003])
    other = np.isin(time, np.arange(80) * 0.05 + 0.003)
    command, place = np.where(other, np.nan, np.round(1000 * time) // 100), np.where(other, time, np.nan)
    pair = {"command": command, "position": place}
    found, notes = held_between(time, pair, {"command": True})
    np.testing.assert_array_equal(found["command"], np.round(1000 * time) // 100)
    assert "rows of the other channels" in notes[0]
    command[other] = np.nan
    command[100:130] = np.nan  # and a stretch of it is missing
    found, _ = held_between(time, pair, {"command": True})
    assert np.isnan(found["command"][105:125]).any()
