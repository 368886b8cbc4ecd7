"""Recordings that begin at rest, in pressures that nothing shows: what misleads a filter is left out, and only that."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from optid.core.recording import Channel, Recording
from optid.diagnosis.beginning import _filtered, begun
from optid.diagnosis.candidate import Data
from optid.estimation.likelihood import Noise, noisy_states
from optid.rigs.rigfile import read_rig
from studies.independent_rig import Rig, Sensors, simulate
from studies.independent_rig import recording as recorded
from studies.references import REFERENCES

SECONDS, DT = 20.0, 1e-3
TRUE = {
    "viscous_friction": 66.0,
    "coulomb_friction": 75.0,
    "discharge_coefficient": 0.77,
    "residual_length": 0.0105,
}
SD = 3e-5  # m


@pytest.fixture(scope="module")
def run():
    """Steps of a rig that lacks nothing, from the start of its loop on."""
    rng, sensors = np.random.default_rng(5), Sensors(position_noise=SD)
    rig = Rig(viscous=66.0, coulomb=75.0, discharge=0.77, residual_length=10.5e-3)
    table = recorded(
        simulate(rig, REFERENCES["steps"](SECONDS, DT, rng, 0.1), rng, sensors=sensors), rng, sensors
    )
    channels = {
        "command": Channel("command", "u", "1", table["u"].to_numpy() / 5.0),
        "position": Channel("position", "x", "m", table["x"].to_numpy() * 1e-3),
    }
    return Recording("steps", table["t"].to_numpy(), channels)


@pytest.fixture(scope="module")
def base():
    """The right model."""
    rig = read_rig(Path(__file__).parents[2] / "data" / "bench.toml")
    model = rig.model
    p = model.vector({**rig.parameters, **TRUE})
    groups = noisy_states(model)
    noise = Noise(np.array([SD**2]), groups, np.full(len(groups), -7.0))
    return SimpleNamespace(rig=rig, answer=SimpleNamespace(p=p, noise=noise))


def data(*train):
    return Data(train, (), {}, np.random.default_rng(0))


def cuts(run):
    """Six seconds of it each, that begin at rest in the midst."""
    speed = np.abs(np.gradient(np.convolve(run["position"].values, np.ones(21) / 21, "same"), run.time))
    still = np.flatnonzero((speed < 2e-3) & (run.time > 2.0) & (run.time < SECONDS - 6.1))[::200]
    return [run.taken(np.arange(row, row + 6000)) for row in still]


def mean_deviance(base, recording):
    return float(np.mean(_filtered(base, recording)[1]))


def test_what_begins_at_rest_misleads_no_more(run, base):
    given = cuts(run)
    before = np.array([mean_deviance(base, one) for one in given])
    usual = float(np.median(before))
    assert (before > usual + 1.0).sum() >= 3  # or there would be nothing to see
    after = np.array([mean_deviance(base, begun(base, data(one)).train[0]) for one in given])
    assert after.max() < usual + 1.0


def test_a_beginning_that_tells_what_it_should_stays(run, base):
    whole = data(run.taken(np.arange(8000)))  # balanced, as the model takes it
    assert begun(base, whole) is whole


def test_what_rests_and_does_not_mislead_stays(run, base):
    resting = [one for one in cuts(run) if np.ptp(one["position"].values[:300]) < 1e-3]
    staying = [one for one in resting if begun(base, data(one)).train[0] is one]
    assert 2 <= len(staying) < len(resting)
    usual = float(np.median([mean_deviance(base, one) for one in cuts(run)]))
    assert max(mean_deviance(base, one) for one in staying) < usual + 1.0


def test_only_the_segment_that_misleads_begins_later_and_the_clock_counts_on(run, base):
    worst = max(cuts(run), key=lambda one: mean_deviance(base, one))
    row = int(np.searchsorted(run.time, worst.time[0]))
    both = run.taken(np.r_[0:1000, row : row + 6000])
    found = begun(base, data(both, run.taken(np.arange(8000))))
    assert found.late == ("steps",) and len(found.train[1]) == 8000
    kept = found.train[0]
    assert kept.time[:1000] == pytest.approx(run.time[:1000], abs=0.0)
    assert run.time[row] < kept.time[1000] < run.time[row] + 3.0
    assert kept.time[-1] == both.time[-1]
    alone = begun(base, data(worst)).train[0]  # of a first segment two samples stay
    assert alone.time[0] == worst.time[0] and len(alone.segments()[0]) == 2
    assert alone.segments()[1].time[0] == kept.time[1000]


def test_what_moves_at_once_stays(run, base):
    position = run["position"].values[run.time < 16.0]
    fast = run.time[np.argmax(np.abs(position[50:] - position[:-50]))]
    one = data(run.slice(fast, fast + 4.0))
    assert begun(base, one) is one
