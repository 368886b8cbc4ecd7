"""Recordings are brought down once for every command, and what noise the rig file states falls with the rate."""

from pathlib import Path

import numpy as np
import pytest

from optid.api.inputs import at_their_rate, given
from optid.core.recording import Recording
from optid.rigs.rigfile import read_rig

RIG = """name = "axis"
model = "emps"
[parameters]
mass = "95 kg"
drive_gain = "35 N/V"
viscous_friction = "200 N s/m"
coulomb_friction = "20 N"
force_offset = "0 N"
[channels]
time = { column = "t", unit = "s" }
command = { column = "u", unit = "V" }
position = { column = "x", unit = "mm", sd = "0.02 mm" }
"""


@pytest.fixture
def rig(tmp_path):
    (tmp_path / "rig.toml").write_text(RIG)
    return read_rig(Path(tmp_path / "rig.toml"))


def run(rig, rate):
    t = np.arange(0, 2, 1 / rate)
    x = 40 * np.sin(9 * t) + np.random.default_rng(0).normal(0, 0.02, len(t))
    return Recording.from_arrays({"t": t, "u": np.sign(np.sin(9 * t)), "x": x}, rig)


def test_stated_noise_falls_with_the_rate(rig):
    (one,), _ = given(rig, run(rig, 8000.0))
    assert one.recording.rate == pytest.approx(1000.0)
    known = at_their_rate(rig, [one])
    assert known.channels["position"].sd == pytest.approx(2e-5 / np.sqrt(8), rel=0.25)
    assert known.channels["command"] is rig.channels["command"]


def test_a_kilohertz_stays_as_it_is(rig):
    before = run(rig, 1000.0)
    (one,), _ = given(rig, before)
    np.testing.assert_array_equal(one.recording["position"].values, before["position"].values)
    assert at_their_rate(rig, [one]) is rig
