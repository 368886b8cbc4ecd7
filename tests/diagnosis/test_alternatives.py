"""Look-alikes in the place of an effect: what a round has fitted already is not fitted again."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from optid.diagnosis import alternatives
from optid.diagnosis.alternatives import Alternative
from optid.diagnosis.criteria import Criteria
from optid.effects.library import admitted
from optid.rigs.rigfile import read_rig
from tests.effects.plants import DATA

NAMED, OTHER, TWIN = (
    SimpleNamespace(name=name, look_alikes=likes)
    for name, likes in (("named", ("twin",)), ("other", ()), ("twin", ()))
)
PROBLEM = SimpleNamespace(criteria=Criteria())


def validated(loss):
    return SimpleNamespace(windows=np.full(40, loss), error_over_noise=1.0)


def contender(effect, loss, why=""):
    return SimpleNamespace(effect=effect, model=f"with {effect.name}", validated=validated(loss), why=why)


def path_of(*rounds):
    steps = [
        SimpleNamespace(model=SimpleNamespace(effects=beside), contenders=contenders)
        for beside, contenders in rounds
    ]
    return SimpleNamespace(
        best=SimpleNamespace(effects=(OTHER, NAMED)), rounds=tuple(steps), validated=validated(0.5)
    )


@pytest.fixture
def fitted_anew(monkeypatch):
    asked = []
    monkeypatch.setattr(alternatives, "_in_place", lambda path, effect, problem: asked.append(effect) or [])
    return asked


def test_a_round_beside_the_same_effects_gives_the_look_alikes(fitted_anew):
    path = path_of(((), ()), ((OTHER,), (contender(NAMED, 0.5), contender(TWIN, 0.5))))
    (found,) = alternatives._others(path, NAMED, PROBLEM)
    assert isinstance(found, Alternative)
    assert (found.effect, found.model, found.told_apart) == (TWIN, "with twin", False)
    assert not fitted_anew


def test_look_alikes_that_were_refused_or_are_none_do_not_count(fitted_anew):
    stranger = SimpleNamespace(name="stranger", look_alikes=())
    met = (contender(TWIN, 0.5, why="no gain"), contender(stranger, 0.5))
    assert alternatives._others(path_of(((OTHER,), met)), NAMED, PROBLEM) == []
    assert not fitted_anew


def test_without_such_a_round_they_are_fitted_anew(fitted_anew):
    path = path_of(((NAMED,), (contender(TWIN, 0.5),)))
    assert alternatives._others(path, NAMED, PROBLEM) == []
    assert fitted_anew == [NAMED]


def test_a_constant_torque_and_an_offset_of_its_command_are_twins():
    """Where the command is a torque or a current they are one and the same."""
    rig = read_rig(DATA / "rotary_axis.toml")
    by_name = {effect.name: effect for effect in admitted(rig.model)}
    offset, force = by_name["offset@drive.command"], by_name["constant_force"]
    assert alternatives.are_confusable(offset, force) and alternatives.are_confusable(force, offset)
    assert not alternatives.are_confusable(offset, by_name["quadratic_drag"])


def test_a_look_alike_that_predicts_better_takes_the_place_and_tells_the_loser_apart(monkeypatch):
    """The loser is worse beyond doubt; models that lack the other effect are fitted anew, beside the winner."""
    monkeypatch.setattr(
        alternatives, "is_told_apart", lambda worse, better, problem: worse.windows[0] > better.windows[0]
    )
    monkeypatch.setattr(alternatives, "_price", lambda one, other: 0.0)
    twin, third = (
        Alternative(effect, f"with {effect.name}", validated(loss), told_apart=False)
        for effect, loss in ((TWIN, 0.25), (SimpleNamespace(name="third", look_alikes=()), 0.4))
    )
    monkeypatch.setattr(
        alternatives, "_others", lambda path, effect, problem: [twin, third] if effect is NAMED else []
    )
    again = []

    def without_effects(path, names, problem):
        again.append((path.best, names))
        return replace(path, without={"other": "lacks other, has twin", "twin": "lacks twin"})

    monkeypatch.setattr(alternatives, "without_effects", without_effects)

    @dataclass
    class Path:
        best: object
        validated: object
        without: dict

    best = SimpleNamespace(effects=(OTHER, NAMED))
    winner = SimpleNamespace(effects=(OTHER, TWIN))
    twin = replace(twin, model=winner)
    problem = SimpleNamespace(criteria=Criteria(), report=lambda stage, words: None)
    path, found = alternatives.compare_alternatives(
        Path(best, validated(0.5), {"other": "lacks other, has named", "named": "lacks named"}), problem
    )
    assert again == [(winner, ())]
    assert path.best is winner and path.without["other"] == "lacks other, has twin"
    assert {one.effect.name: one.told_apart for one in found["twin"]} == {"named": True, "third": True}


def test_the_site_of_a_generic_law_costs_as_much_as_a_parameter():
    by_name = {effect.name: effect for effect in admitted(read_rig(DATA / "rotary_axis.toml").model)}
    offset, force, lag = (by_name[n] for n in ("offset@drive.command", "constant_force", "sensor_lag"))
    assert len(offset.fitted) == len(force.fitted) == 1 and len(lag.fitted) == 2
    assert alternatives._price(force, offset) == -1.0 and alternatives._price(offset, force) == 1.0
    assert alternatives._price(offset, lag) == 0.0


def test_windows_that_differ_by_less_than_a_log_likelihood_of_one_tell_nothing_apart():
    """Every window is worse by a little, as where two fits of the same law end a little apart."""
    mine, near, worse = validated(0.5), validated(0.5 + 0.9 / 40), validated(0.5 + 3.5 / 40)
    assert not alternatives.is_told_apart(near, mine, PROBLEM)
    assert alternatives.is_told_apart(worse, mine, PROBLEM)
