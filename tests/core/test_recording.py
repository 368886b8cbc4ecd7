"""Recordings: what they hold cannot change, and time is what it says."""

from pathlib import Path

import numpy as np
import pytest

from optid.core.recording import Channel, Provenance, Recording
from optid.core.recording_set import Experiments
from optid.errors import RecordingError


def recording(time, name="steps.csv", source=None, **channels):
    found = {role: Channel(role, role, "m", np.asarray(values, float)) for role, values in channels.items()}
    return Recording(name, np.asarray(time, float), found, source)


def source(path, digest):
    return Provenance(Path(path), digest, "csv", {"time": "t"}, 10)


def test_rate_duration_and_length():
    r = recording([0, 0.001, 0.002, 0.0031], x=[1, 2, 3, 4])
    assert (len(r), r.rate, r.duration) == (4, pytest.approx(1000), pytest.approx(0.0031))


def test_arrays_are_read_only_copies():
    mine = np.arange(3.0)
    r = recording([0, 1, 2], x=mine)
    mine[0] = 99.0
    assert r["x"].values[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        r["x"].values[0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        r.time[0] = 1.0


def test_recorded_undoes_the_full_scale():
    u = Channel("command", "u", "1", np.array([0.0, 1.0, np.nan]), per_unit=5.0, recorded_unit="V")
    np.testing.assert_array_equal(u.recorded, [0.0, 5.0, np.nan])
    assert u.missing == 1


@pytest.mark.parametrize("time", [[0.0], [0, 1, 1], [0, 2, 1], [0, np.nan, 1], [[0, 1]]])
def test_time_must_increase(time):
    with pytest.raises(RecordingError, match=r"steps\.csv"):
        recording(time)


def test_lengths_must_agree():
    with pytest.raises(RecordingError, match="x: 2 values; expected 3"):
        recording([0, 1, 2], x=[1, 2])


def test_unknown_channel_names_the_nearest():
    with pytest.raises(RecordingError, match='did you mean "position"'):
        recording([0, 1], position=[1, 2])["positon"]


def test_slice_holds_its_start_and_not_its_stop():
    r = recording(np.arange(10) / 10, x=np.arange(10)).slice(0.2, 0.5)
    np.testing.assert_allclose(r.time, [0.2, 0.3, 0.4])
    np.testing.assert_array_equal(r["x"].values, [2, 3, 4])
    with pytest.raises(RecordingError, match=r"runs from 0\.2 to 0\.4 s"):
        r.slice(7, 8)


def test_gaps_and_segments_follow_the_median_interval():
    time = np.concatenate([np.arange(100), np.arange(102, 200), np.arange(230, 300), [400]]) * 1e-3
    r = recording(time, x=time)
    np.testing.assert_allclose(r.gaps(), [(0.099, 0.102), (0.199, 0.23), (0.299, 0.4)])
    first, second = r.segments()  # the lone last sample carries no motion; 3 ms are held through
    assert (len(first), len(second)) == (198, 70)
    assert second.time[0] == 0.23


def test_missing_samples_are_counted_by_channel():
    assert recording([0, 1, 2], x=[1, np.nan, np.nan], y=[1, 2, 3]).missing == {"x": 2}


def test_frame_has_a_column_for_every_role():
    frame = recording([0, 1], x=[1, 2], y=[3, 4]).to_frame()
    assert list(frame.columns) == ["time", "x", "y"]
    assert frame.y.tolist() == [3, 4]


def test_experiments_tell_equal_names_apart():
    a = recording([0, 1], source=source("monday/steps.csv", "a"))
    b = recording([0, 1], source=source("tuesday/steps.csv", "b"))
    c = recording([0, 1], name="ramps.csv", source=source("tuesday/ramps.csv", "c"))
    names = [r.name for r in Experiments.of([a, b, c])]
    assert names == ["monday/steps.csv", "tuesday/steps.csv", "ramps.csv"]
    assert Experiments.of([a, c])["steps.csv"] is not None
    with pytest.raises(RecordingError, match=r'did you mean "ramps\.csv"'):
        Experiments.of([a, c])["ramp.csv"]


def test_experiments_number_what_folders_do_not_tell_apart():
    parts = recording(np.arange(10), source=source("monday/steps.csv", "a"))
    names = [r.name for r in Experiments.of([parts.slice(0, 5), parts.slice(5, 10)])]
    assert names == ["monday/steps.csv", "monday/steps.csv (2)"]


def test_experiments_refuse_the_same_samples_twice():
    a = recording(np.arange(10), source=source("steps.csv", "a"))
    copy = recording(np.arange(10), name="copy.csv", source=source("copy.csv", "a"))
    for twin in (a, copy, a.slice(3, 6)):
        with pytest.raises(RecordingError, match="twice"):
            Experiments.of([a, twin])
