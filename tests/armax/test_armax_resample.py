"""Recordings on an even grid: gaps become missing samples, jitter does not."""

from __future__ import annotations

import numpy as np
import pytest

from optid.armax.resample import LONGEST_GAP, resample
from optid.core.recording import Channel, Recording
from optid.errors import InputError


def recorded(time, **more) -> Recording:
    time = np.asarray(time, dtype=float)
    channels = {
        "position": Channel("position", "x", "m", np.arange(time.size, dtype=float)),
        "command": Channel("command", "u", "1", 0.1 * np.arange(time.size), per_unit=5.0, recorded_unit="V"),
    }
    return Recording("run.csv", time, channels | more)


def test_values_units_and_time():
    sampled = resample(recorded([0.0, 0.01, 0.02, 0.03]), "position", ["command"])
    assert sampled.sample_time == pytest.approx(0.01)
    assert sampled.signals.y.tolist() == [0.0, 1.0, 2.0, 3.0]
    assert sampled.signals.u[:, 0] == pytest.approx([0.0, 0.5, 1.0, 1.5])
    assert (sampled.output_unit, sampled.input_units) == ("m", ("V",))


def test_a_gap_becomes_missing_samples_and_jitter_none():
    sampled = resample(recorded([0.0, 0.0102, 0.0198, 0.03, 0.06, 0.07]), "position", ["command"])
    assert np.isnan(sampled.signals.y).tolist() == [False] * 4 + [True] * 2 + [False] * 2
    assert np.isnan(sampled.signals.u[:, 0]).tolist() == np.isnan(sampled.signals.y).tolist()
    assert sampled.time[-1] == pytest.approx(0.07)


def test_a_night_s_gap_costs_no_memory():
    sampled = resample(recorded([*np.arange(5.0), 1e12, 1e12 + 1]), "position", ["command"])
    assert sampled.time.size == 5 + LONGEST_GAP + 1
    assert sampled.time[-1] == 1e12 + 1


@pytest.mark.parametrize(
    ("output", "inputs", "message"),
    [
        ("postion", ["command"], 'did you mean "position"'),
        ("position", ["pressure_a"], "no channel"),
        ("position", ["position"], "differ"),
        ("position", ["command", "command"], "differ"),
    ],
)
def test_channels_that_are_not_there(output, inputs, message):
    with pytest.raises(InputError, match=message):
        resample(recorded([0.0, 1.0, 2.0]), output, inputs)
