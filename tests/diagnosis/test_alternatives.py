"""Look-alikes in the place of an effect: what a round has fitted already is not fitted again."""

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
