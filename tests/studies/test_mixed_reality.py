"""The study's own arithmetic, and its rig as a driver."""

import numpy as np
import pandas as pd
import pytest

from studies.live_rig import REAL, LiveRig
from studies.mixed_reality import Session, median, merits, profiles, session, steps_of


def test_merits_of_a_step_are_those_of_its_error():
    t = 1e-3 * np.arange(5000)
    r = np.where(t < 1.0, 0.0, 50.0)
    x = np.where(t < 1.0, 0.0, 50.0 * (1 - np.exp(-(t - 1.0) / 0.1)))
    log = pd.DataFrame({"t": t, "r": r, "x": x})
    found = merits(log, 1.0, 50.0)
    assert found["iae"] == pytest.approx(0.05 * 0.1, rel=0.01)
    assert found["itae"] == pytest.approx(0.05 * 0.1**2, rel=0.01)
    assert found["arrival"] == pytest.approx(0.1 * np.log(50 / 2), abs=2e-3)
    assert steps_of(log, 0.0, 5.0) == [found]
    assert median([{"a": 1.0}, {"a": 5.0}, {"a": 2.0}]) == {"a": 2.0}


def test_the_profiles_have_no_jump_but_the_stairs():
    reference = profiles()
    jumps = np.abs(np.diff(reference.values))
    assert np.sum(jumps > 1e-3) == 3
    assert max(map(abs, reference.values)) < 0.1


def test_the_rig_obeys_and_is_noisy():
    rig = LiveRig(REAL, 1)
    rest = [rig.read(1e-3 * n)[0] for n in range(50)]
    assert np.std(rest) == pytest.approx(0.03, rel=0.4)
    assert rig.write(1.0004, 0.05) == pytest.approx(1.0, abs=2e-3)
    assert rig.read(0.4)[0] > 10.0


def test_a_session_of_the_study_follows_and_fits(tmp_path):
    from optid.live.reference import Reference
    from optid.pid.controller import Gains

    run = session(tmp_path / "log.csv", Reference((0.0, 0.6), (0.0, 0.05)), 2.0, Gains(30.0))
    assert isinstance(run, Session)
    assert run.log["x"].iloc[-1] == pytest.approx(50.0, abs=4.0)
    assert run.fits()["predicted"] > 99
