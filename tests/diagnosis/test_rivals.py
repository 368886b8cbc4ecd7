"""Look-alikes in the place of what was named: told to be as good, put in its place, or left where they do worse."""

from dataclasses import replace
from types import MappingProxyType, SimpleNamespace

import numpy as np
import pytest

from optid.core.parameter import Parameter
from optid.diagnosis import rivals
from optid.diagnosis.candidate import Data, fit_base, refitted, settled
from optid.diagnosis.rivals import compared, indistinguishable
from optid.diagnosis.search import Instead, Round, Search
from optid.effects.effect import Effect
from tests.diagnosis.trolley import TRUTH, recording, rig

OFFSET = 0.15  # of full command


class _Constant(Effect):
    equation, says, depends_on, needs, source = "own", "constant", (), "motion", "a test"

    def apply(self, site, nominal, near, sheet):
        return nominal + sum(sheet.param(q) for q in self.parameters)


def parameter(name, typical):
    return Parameter(name, "1", typical, name, "a test", 0.0, (-50.0, 50.0))


class Tilt(_Constant):
    """A constant pull, which nothing tells from an offset of the command on this plant."""

    name, sites, law, look_alikes = "tilt", ("drag.force",), "F", ("offset_in_two",)
    parameters = (Parameter("pull", "m/s**2", 0.5, "pull", "a test", 0.0, (-50.0, 50.0)),)
    strength = MappingProxyType({"pull": 0.01})
    usual = ({"pull": 0.5}, {"pull": -0.5})


class OffsetInTwo(_Constant):
    """An offset of the command as a sum of two: as good, and dearer by a parameter."""

    name, sites, law, look_alikes = "offset_in_two", ("drive.command",), "a + b", ("sag",)
    parameters = (parameter("a", 0.1), parameter("b", 0.1))
    strength = MappingProxyType({"a": 0.01, "b": 0.01})
    usual = ({"a": 0.1, "b": 0.0}, {"a": -0.1, "b": 0.0})


class Sag(_Constant):
    """A sensor's offset: declared alike, and worse."""

    name, sites, law = "sag", ("sensor.position",), "x + c"
    parameters = (Parameter("c", "m", 0.05, "offset", "a test", 0.0, (-50.0, 50.0)),)
    strength = MappingProxyType({"c": 0.001})
    usual = ({"c": 0.05}, {"c": -0.05})


TILT, TWO, SAG = Tilt(), OffsetInTwo(), Sag()


@pytest.fixture(scope="module")
def pushed(tmp_path_factory):
    """The model of a trolley with an offset of its command, as a search would hand it on with one of the effects."""
    train = tuple(recording(seed, f"run{seed}.csv", lambda u: u + OFFSET) for seed in (1, 2))
    held = (recording(3, "held.csv", lambda u: u + OFFSET),)
    data = Data(train, held, {"position": 5e-4}, np.random.default_rng(0))
    base = fit_base(rig(tmp_path_factory.mktemp("trolley")), data, lambda share, words: None)

    def found(effect):
        rough = refitted(base.rig, (effect,), base, data, base.rig.model)
        best = settled(rough.effects, rough.rig, rough.answer.p, rough.answer, data, base.rig.model)
        return Search(base, best, (), {effect.name: base})

    return found, data


def test_the_simpler_of_two_that_do_as_well_takes_the_place_and_the_other_is_told(pushed):
    found, data = pushed
    told = []
    after = compared(found(TWO), (TILT, TWO, SAG), data, told.append)
    assert [effect.name for effect in after.best.effects] == ["tilt"]
    model = after.best.rig.model
    pull = after.best.answer.p[model.index("tilt.pull")]
    assert pull == pytest.approx(-OFFSET * TRUTH["gain"], rel=0.02)
    assert after.without == {"tilt": after.base}
    assert [(one.effect.name, one.level) for one in after.instead["tilt"]] == [("offset_in_two", True)]
    assert indistinguishable(after, TILT, data) == ("offset_in_two",)
    assert told == ["what else could stand in the place of offset_in_two"]


def test_a_look_alike_starts_from_where_the_named_model_stands_too(pushed, monkeypatch):
    """Held gains lead parameters away that they hardly see."""
    found, data = pushed
    before, tried = found(TILT), []

    def kept(question, starts):
        tried.append([p[[question.model.index(name) for name in TRUTH]] for p, _ in starts])
        return starts[0]

    monkeypatch.setattr(rivals, "likeliest", kept)
    compared(before, (TILT, TWO), data, lambda words: None)
    stands = before.best.answer.p[[before.best.rig.model.index(name) for name in TRUTH]]
    (starts,) = tried
    assert len(starts) == 2
    assert any(np.array_equal(p, stands) for p in starts)


def test_the_simpler_one_stays_and_the_dearer_is_told(pushed):
    found, data = pushed
    before = found(TILT)
    after = compared(before, (TILT, TWO, SAG), data, lambda words: None)
    assert after.best is before.best
    assert indistinguishable(after, TILT, data) == ("offset_in_two",)


def test_what_is_not_alike_has_no_part_in_it(pushed):
    found, data = pushed
    before = found(TILT)
    after = compared(before, (TILT, SAG), data, lambda words: None)
    assert after.best is before.best
    assert indistinguishable(after, TILT, data) == ()


@pytest.mark.parametrize(("level", "names"), [(True, ("offset_in_two",)), (False, ())])
def test_what_held_gains_cannot_tell_apart_is_told_though_likelihood_differs(pushed, level, names):
    """How friction rests, which a search finds or misses, makes hundreds of units between two names of one force."""
    found, data = pushed
    search = found(TILT)
    instead = {"tilt": (Instead(TWO, search.base, level),)}
    assert indistinguishable(replace(search, instead=instead), TILT, data) == names


@pytest.mark.parametrize(("p_value", "best"), [(0.5, "tilt"), (0.01, "offset_in_two")])
def test_a_better_fit_takes_the_place_unless_the_hold_out_prefers_the_named_one(
    pushed, p_value, best, monkeypatch
):
    found, data = pushed
    monkeypatch.setattr(rivals, "compare", lambda *others: SimpleNamespace(p_value=p_value))
    after = compared(found(TWO), (TILT, TWO), data, lambda words: None)
    assert [effect.name for effect in after.best.effects] == [best]
    assert list(after.instead) == [best]


def test_rivals_of_its_round_that_do_as_well_are_told_too(pushed):
    found, data = pushed
    search, other = found(TILT), found(TWO)

    def rival(effect, candidate, gain):
        return SimpleNamespace(effect=effect, candidate=candidate, train_gain=gain)

    mine = rival(TILT, search.best, 1000.0)
    for gain, names in ((950.0, ("offset_in_two",)), (800.0, ())):
        those = (mine, rival(TWO, other.best, gain), rival(SAG, search.base, 990.0))
        one = Round(search.base, (), those, mine, mine)
        with_round = Search(search.base, search.best, (one,), search.without)
        assert indistinguishable(with_round, TILT, data) == names


@pytest.mark.parametrize(("least", "names"), [(0.01, ("offset_in_two",)), (10.0, ())])
def test_a_part_that_another_effect_has_as_its_law_is_told_if_it_matters(pushed, least, names):
    """A pull of 0.45 m/s2 shares its law with an offset; below the smallest size worth a name that says nothing."""
    found, data = pushed
    search = found(TILT)

    class Shared(Tilt):
        strength = MappingProxyType({"pull": least})
        shares = MappingProxyType({"pull": "offset_in_two"})

    shared = Shared()
    search = replace(search, best=replace(search.best, effects=(shared,)))
    assert indistinguishable(search, shared, data) == names
