"""What errs beyond the noise is settled by its windows: to a likelier top, or to parameters that predict better."""

from dataclasses import replace

import numpy as np
import pytest

from optid.diagnose.candidate import Candidate, Data, fit_base
from optid.diagnose.judge import EXCESS, excess, judge
from optid.diagnose.settling import foreseen, likelier
from optid.fit.multistep import foreseeing, misses, misses_unseen
from optid.fit.place import Place
from tests.diagnose.trolley import SD, TRUTH, recording, rig


def fitted(folder, concealed, later=None):
    """A base fit of two recordings, the second with something else concealed on request."""
    train = [recording(1, "run_1", concealed), recording(2, "run_2", later or concealed)]
    data = Data(tuple(train), (recording(3, "held", concealed),), {"position": SD}, np.random.default_rng(0))
    return fit_base(rig(folder), data, lambda share, words: None), data


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    return fitted(tmp_path_factory.mktemp("sound"), lambda u: u)


def lagging(u):
    """By 0.15 s."""
    late = np.exp(-np.arange(120) / 15.0)
    return np.convolve(u, late / late.sum())[: len(u)]


@pytest.fixture(scope="module")
def bent(tmp_path_factory):
    """What pushes lags behind the command."""
    return fitted(tmp_path_factory.mktemp("bent"), lagging)


@pytest.fixture(scope="module")
def astray(sound):
    """The sound model beside its top: twice the drag, and process noise that makes up for it."""
    base, data = sound
    p = base.answer.p.copy()
    p[base.rig.model.index("drag")] *= 2.0
    noise = replace(base.answer.noise, levels=np.full_like(base.answer.noise.levels, -1.0))
    place = Place(base.answer.question, p, noise)
    place.differentiate()
    answer = place.answer(True)
    return Candidate((), base.rig, answer, judge(answer, data.holdout))


def test_what_is_good_to_the_noise_stays(sound):
    base, data = sound
    assert excess(base.judged, data.noise) <= EXCESS
    assert likelier(base, data) is base
    same, apart = foreseen(base, data)
    assert same is base and not apart.any()


def test_windows_lead_to_the_likelier_top(sound, astray):
    base, data = sound
    found = likelier(astray, data)
    assert found.answer.score == pytest.approx(base.answer.score, abs=2.0)
    values = dict(zip((q.name for q in found.rig.model.parameters), found.answer.p, strict=True))
    assert {name: values[name] for name in TRUTH} == pytest.approx(TRUTH, rel=0.01)
    assert excess(found.judged, data.noise) <= EXCESS


def test_a_likelier_top_is_left_where_windows_miss_more_than_they_led_to(sound, astray, monkeypatch):
    _, data = sound
    monkeypatch.setattr("optid.diagnose.settling.preferable", lambda likely, led, seconds: led)
    assert likelier(astray, data) is astray


def test_no_time_nothing_is_settled(sound, astray):
    _, data = sound
    hurried = replace(data, until=0.0)
    assert likelier(astray, hurried) is astray
    assert foreseen(astray, hurried)[0] is astray


def test_a_law_that_is_not_natures_gets_what_predicts_its_recordings_and_says_how_far_that_is(bent):
    base, data = bent
    found, apart = foreseen(base, data)
    seconds = base.judged.horizon
    assert misses(found.answer, seconds) < 0.98 * misses(base.answer, seconds)
    free = list(base.answer.question.free)
    assert apart == pytest.approx(np.abs(found.answer.p - base.answer.p)[free])
    assert (apart > 0.0).all()
    assert found.judged is not base.judged
    assert likelier(base, data).answer.score <= base.answer.score


def test_what_serves_one_recording_alone_is_not_taken(tmp_path):
    """One rig's command lags, the other's saturates: parameters that predict both best predict neither unseen."""
    base, data = fitted(tmp_path, lagging, later=lambda u: np.clip(u, -0.3, 0.5))
    seconds = base.judged.horizon
    led = foreseeing(base.answer, seconds)
    assert misses(led, seconds) < 0.98 * misses(base.answer, seconds) < misses_unseen(led, seconds)
    found, apart = foreseen(base, data)
    assert found is base and not apart.any()
