"""Long recordings are checked at a bounded cost and short ones diagnosed; the answer says on what it rests."""

from dataclasses import replace

import numpy as np
import pytest

from optid.api import checking
from optid.core.recording import Channel, Recording
from optid.diagnosis.testing import gate
from optid.errors import InputError
from optid.estimation.problem import window_seconds


def recorded(samples):
    t = np.arange(samples) * 1e-3
    y = 0.05 * np.sin(3 * t)
    y[samples // 2] = 0.09
    return Recording(
        "long",
        t,
        {
            "command": Channel("command", "u", "1", np.sign(np.sin(3 * t)), per_unit=5.0, held=True),
            "position": Channel("position", "x", "m", y),
        },
    )


def test_a_picture_of_a_long_recording_shows_its_extremes(monkeypatch):
    monkeypatch.setattr(checking, "_DRAWN", 100)
    whole = recorded(10_000)
    frame = checking._signals([whole])
    assert len(frame) == 200
    assert frame["position"].max() == 0.09
    assert frame["command"].min() == -5.0
    assert frame["time"].is_monotonic_increasing


def test_a_short_recording_is_drawn_whole():
    frame = checking._signals([recorded(300)])
    np.testing.assert_array_equal(frame["position"], recorded(300)["position"].values)


def test_long_recordings_are_examined_on_stretches_of_all_of_them(monkeypatch):
    monkeypatch.setattr(checking, "_EXAMINED", 800)
    parts, said = checking._excerpts([recorded(10_000), recorded(300)])
    assert sum(map(len, parts)) < 1700
    assert parts[0].time[0] == 0.0
    assert max(one.time[-1] for one in parts) == pytest.approx(9.999)
    assert said and "10.3 s" in said[0]


def test_short_recordings_are_examined_whole():
    whole = [recorded(1000)]
    assert checking._excerpts(whole) == (whole, [])


def test_a_record_of_a_second_has_enough_windows():
    assert window_seconds(1e-3, 0.999) == pytest.approx(0.999 / 8)
    assert window_seconds(1e-3, 2.0) == window_seconds(1e-3) == 0.5
    gate([recorded(1000)], ("position",), ("command",))
    with pytest.raises(InputError, match=r"windows of 0\.05 s"):  # of fifty samples at least
        gate([recorded(120)], ("position",), ("command",))


def thinned(one, keep):
    """The recording with the position measured at some rows only."""
    position = one["position"]
    values = np.where(keep, position.values, np.nan)
    return replace(one, channels={**one.channels, "position": replace(position, values=values)})


def test_a_sensor_slower_than_the_log_has_its_windows():
    """Every fourth row of 4 s is 4 s; as many rows in one piece are one second, and scattered ones count alone."""
    one, rows = recorded(4000), np.arange(4000)
    gate([thinned(one, rows % 4 == 0)], ("position",), ("command",))
    scattered = np.isin(rows, np.random.default_rng(0).choice(rows, 1000, replace=False))
    for keep in (rows < 1000, scattered):
        with pytest.raises(InputError, match=r"only 2\.0 windows"):
            gate([thinned(one, keep)], ("position",), ("command",))
