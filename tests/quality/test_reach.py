"""A position that the rig cannot have: its zero at an end, another unit, another stroke."""

import numpy as np
import pytest

import optid
from optid.core.recording import Channel, Recording
from optid.quality.reach import reach
from optid.quality.verdict import verdict
from tests.rigs.test_contradictions import DATA

RIG = optid.read_rig(DATA / "bench.toml")  # a stroke of 260 mm about its middle
TIME = np.arange(4000) * 1e-3


def recording(middle=0.0, half=0.1, at=()):
    x = middle + half * np.sin(3 * TIME)
    for k in at:
        x[k] = 9.0
    channels = {
        "command": Channel("command", "u", "1", 0.5 * np.cos(3 * TIME)),
        "position": Channel("position", "x", "m", x),
    }
    return Recording("run.csv", TIME, channels)


def found(one, parameters=RIG.parameters):
    return list(reach(one, RIG.model, parameters))


@pytest.mark.parametrize("half", [0.1, 0.13, 0.135])
def test_a_position_within_the_stroke_is_sound(half):
    assert found(recording(half=half)) == []


def test_a_zero_at_an_end_is_told_with_both_ranges():
    (remark,) = found(recording(middle=0.13))
    assert remark.severity == "error"
    assert "30 mm to 230 mm" in remark.message and "-130 mm to 130 mm" in remark.message
    assert "offset" in remark.message


def test_another_unit_is_told():
    (remark,) = found(recording(half=100.0))
    assert "unit" in remark.message


def test_single_readings_are_no_motion():
    assert found(recording(at=(100,))) == []


def test_without_the_rigs_numbers_nothing_is_said():
    assert found(recording(middle=0.13), None) == []


def test_what_a_recording_has_of_its_own_counts():
    assert found(recording(half=0.2)) != []
    assert found(recording(half=0.2), {**RIG.parameters, "stroke": 0.4}) == []


def test_the_check_calls_it_unfit_for_the_plant_only():
    one = recording(middle=0.13)
    said = verdict([(one, found(one))], (), ("stroke",), "RIG run.csv")
    assert said.fit_for == ("simulate", "identify")
    assert "offset" in said.next
