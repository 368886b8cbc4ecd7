"""Where an unknown input explains the recordings best: what drives the trolley, or what reads it."""

from dataclasses import replace

import numpy as np
import pytest

from optid.diagnosis.base_fit import fit_base
from optid.diagnosis.localisation.unknown_input import locate, push
from optid.diagnosis.pipeline import diagnose
from optid.diagnosis.result import Verdict
from tests.diagnosis.trolley import RATE, problem_of, recording, rig

N = 1200
PULL = 0.3 * np.sin(2.0 * np.pi * 0.7 * np.arange(N) / RATE)  # of full command
JUMPS = 0.005 * np.sign(np.sin(2.0 * np.pi * 0.2 * np.arange(N) / RATE + 0.2))  # m


def misread(one):
    x = one["position"]
    return replace(one, channels={**one.channels, "position": replace(x, values=x.values + JUMPS)})


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    train = [recording(s, f"{s}.csv", lambda u: u + PULL) for s in (1, 2)]
    return fit_base(problem_of(tmp_path_factory.mktemp("driven"), train))


def test_a_pull_is_found_where_it_drives_and_as_it_was(driven):
    found = locate(*driven)
    assert {found[0].site, found[1].site} == {"drive.command", "drag.force"}  # one force on this plant
    assert found[0].gain - found[1].gain < 3.0
    assert found[-1].site == "sensor.position"
    assert found[-1].gain < found[0].gain - 100.0
    there = next(one for one in found if one.site == "drive.command")
    signal, within = there.signal, np.abs(there.signal - np.tile(PULL, 2)) < 1.96 * there.signal_sd
    assert 0.9 < within.mean() < 1.0  # its interval holds what is there
    assert np.corrcoef(signal, np.tile(PULL, 2))[0, 1] > 0.9  # told from the past alone
    assert signal.std() == pytest.approx(PULL.std(), rel=0.2)


def test_a_misreading_is_found_at_the_sensor(tmp_path):
    found = locate(*fit_base(problem_of(tmp_path, [misread(recording(s, f"{s}.csv")) for s in (1, 2)])))
    assert found[0].site == "sensor.position"
    assert found[0].gain > found[1].gain + 100.0
    assert np.corrcoef(found[0].signal, np.tile(JUMPS, 2))[0, 1] > 0.95


def test_a_push_of_the_found_size_moves_innovations_by_a_tenth_of_their_noise_or_more(driven):
    base, problem = driven
    size = push(base, problem, "drive.command")
    assert 1e-6 < size < 10.0


def test_recordings_at_the_noise_do_not_show_where_a_hold_out_deviates(tmp_path):
    """Something acts in the recording held out alone: it is unexplained, and no site is told."""
    train = [recording(s, f"{s}.csv") for s in (1, 2, 3)]
    odd = recording(4, "odd.csv", lambda u: u + 3.0 * PULL)
    found = diagnose(rig(tmp_path), train, [odd])
    assert found.verdict is Verdict.UNEXPLAINED
    assert found.findings == ()
    assert "The site could not be determined." in found.summary
