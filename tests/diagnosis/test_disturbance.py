"""Where an unknown signal explains the recordings best: what drives the trolley, or what reads it."""

from dataclasses import replace

import numpy as np
import pytest

from optid.diagnosis.candidate import Data, fit_base
from optid.diagnosis.disturbance import LOUD, locate, locate_at, push
from optid.diagnosis.unexplained import nameless
from tests.diagnosis.trolley import RATE, recording, rig

N = 1200
PULL = 0.3 * np.sin(2.0 * np.pi * 0.7 * np.arange(N) / RATE)  # of full command
JUMPS = 0.005 * np.sign(np.sin(2.0 * np.pi * 0.2 * np.arange(N) / RATE + 0.2))  # m


def pulled(u):
    return u + PULL


def misread(one):
    x = one["position"]
    return replace(one, channels={**one.channels, "position": replace(x, values=x.values + JUMPS)})


def base_of(folder, train):
    data = Data(tuple(train), tuple(train[:1]), {"position": 5e-4}, np.random.default_rng(0))
    return fit_base(rig(folder), data, lambda share, words: None), data


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    return base_of(tmp_path_factory.mktemp("driven"), [recording(s, f"{s}.csv", pulled) for s in (1, 2)])


def test_a_pull_is_found_where_it_drives_and_as_it_was(driven):
    found = locate(*driven)
    assert {found[0].site, found[1].site} == {"drive.command", "drag.force"}  # one force on this plant
    assert found[-1].site == "sensor.position"
    assert found[-1].gain < found[0].gain - 100.0
    signal = next(one.signal for one in found if one.site == "drive.command")
    assert np.corrcoef(signal, np.tile(PULL, 2))[0, 1] > 0.9  # told from the past alone
    assert signal.std() == pytest.approx(PULL.std(), rel=0.2)


def test_a_misreading_is_found_at_the_sensor(tmp_path):
    base, data = base_of(tmp_path, [misread(recording(s, f"{s}.csv")) for s in (1, 2)])
    found = locate(base, data)
    assert found[0].site == "sensor.position"
    assert found[0].gain > found[1].gain + 100.0
    assert np.corrcoef(found[0].signal, np.tile(JUMPS, 2))[0, 1] > 0.95


def test_nothing_but_the_signal_is_uncertain(driven):
    """The states' own noise would take a part of it."""
    found = locate_at(*driven, "drive.command")
    noise = found.answer.noise
    names = [state.name for state in found.answer.question.model.states]
    assert [names[i] for group in noise.groups for i in group] == ["unknown.signal_0"]
    assert found.gain > 1e3


def test_a_finding_without_a_name_tells_the_sites_that_do_as_well(driven):
    base, data = driven
    found = locate(base, data)
    finding = nameless(base, [*found, *found], None, data)  # a site that stands there twice is told once
    assert (finding.effect, finding.place) == (None, found[0].site)
    other = next(one for one in ("drive.command", "drag.force") if one != found[0].site)
    assert finding.sentence.endswith(f"explains the recordings best; {other} would do nearly as well")
    assert finding.train_gain == found[0].gain


def test_what_pulls_for_a_while_is_told_by_when_it_does(tmp_path):
    time = np.arange(N) / RATE
    for_a_while = (time >= 4.0) & (time < 8.0)
    base, data = base_of(
        tmp_path, [recording(s, f"{s}.csv", lambda u: u + PULL * for_a_while) for s in (1, 2)]
    )
    finding = nameless(base, [locate_at(base, data, "drive.command")], None, data)
    for one in data.train:
        told = [(a, b) for name, a, b in finding.region.intervals if name == one.name]
        works = np.any([(time >= a) & (time < b) for a, b in told], axis=0)
        assert np.sum(works & for_a_while) > 0.8 * np.sum(works | for_a_while)


def test_where_a_model_with_held_gains_loses_track_a_walk_is_tried_by_the_signals_usual_size(
    driven, monkeypatch
):
    base, data = driven
    model = base.rig.model
    lost = np.full((1, sum(len(one) for one in data.train), len(model.outputs)), np.nan)
    monkeypatch.setattr("optid.diagnosis.disturbance.run_steered", lambda *args, **named: lost)
    size = model.sizes[model.sites.index("drive.command")]
    assert push(base, data, "drive.command") == size / LOUD > 0.0
