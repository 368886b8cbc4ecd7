"""Long recordings: what is kept of them."""

import numpy as np
import pytest

from optid.diagnose.excerpt import _evenly, excerpts
from tests.diagnose.trolley import RATE, recording, rig

LONG, ENOUGH, STRETCH = 60.0, 2400, 4.0  # s, samples, s
WEAK = (2150, 2350)  # rows in which the drive gives half


def weak(u):
    rows = np.arange(len(u))
    return np.where((rows >= WEAK[0]) & (rows < WEAK[1]), 0.5, 1.0) * u


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """Of two long recordings, the second of which goes wrong for two seconds."""
    given = [recording(1, "one.csv", seconds=LONG), recording(2, "two.csv", weak, seconds=LONG)]
    return given, excerpts(rig(tmp_path_factory.mktemp("long")), given, ENOUGH)


def test_short_recordings_stay_as_they_are(tmp_path):
    given = [recording(1, "one.csv", seconds=12.0), recording(2, "two.csv", seconds=12.0)]
    assert excerpts(rig(tmp_path), given, ENOUGH) == tuple(given)
    some = sum(map(len, excerpts(rig(tmp_path), given, ENOUGH - 400)))
    assert ENOUGH - 400 - STRETCH * RATE / 2 < some < ENOUGH


def test_no_more_than_enough_is_kept(kept):
    given, found = kept
    assert [one.name for one in found] == ["one.csv", "two.csv"]
    assert abs(sum(map(len, found)) - ENOUGH) < STRETCH * RATE / 2
    for whole, part in zip(given, found, strict=True):
        rows = np.searchsorted(whole.time, part.time)
        np.testing.assert_array_equal(whole.time[rows], part.time)
        np.testing.assert_array_equal(whole["position"].values[rows], part["position"].values)


def test_a_minutes_fault_is_kept_and_so_is_the_start_of_the_clock(kept):
    given, (one, two) = kept
    assert one.time[0] == two.time[0] == 0.0
    fault = given[1].time[WEAK[0] : WEAK[1]]
    assert np.isin(fault, two.time).all()


def test_stretches_begin_in_fast_motion(kept):
    given, found = kept
    for whole, part in zip(given, found, strict=True):
        speed = np.abs(np.gradient(whole["position"].values, whole.time))
        begins = part.time[1:][np.diff(part.time) > 1.5 / RATE]
        assert len(begins) > 0
        for time in begins:
            near = np.abs(whole.time - time) <= 1.0
            at = np.abs(whole.time - time) <= 0.05
            assert speed[at].mean() > 0.8 * np.quantile(speed[near], 0.9)


def test_the_rest_lies_at_even_distances():
    every = [(0, k, k + 1) for k in range(10)]
    assert _evenly(every, [0], 4) == [0, 2, 5, 8]
    assert _evenly(every, [0, 5], 4) == [0, 3, 5, 8]
    assert _evenly(every, [0, 5], 1) == [0, 5]
