"""A level that ages at rest: how it grows, how motion ends it, and that rig files hold it."""

from pathlib import Path

import numpy as np
import pytest

from optid.core.sheet import build
from optid.effects.ageing import FORGOTTEN, Ageing
from optid.effects.library import admitted, find_effect
from optid.rigs.servo_pneumatic import servo_pneumatic
from tests.effects.plants import grown

AGEING = Ageing("force.coulomb", "velocity", size=0.2, slow=2e-3)


def rates(effects, own, **states):
    """Of the axis, by state, elsewhere at rest with 3 bar on either side."""
    model = build(servo_pneumatic, effects)
    usual = {"pressure_a": 3e5, "pressure_b": 3e5, **states}
    x = [usual.get(one.name, 0.0) for one in model.states]
    p = model.vector({**grown("servo-pneumatic").values, **own})
    found = np.array(model.rates(x, [0.0] * len(model.inputs), p)).ravel()
    return {one.name: float(value) for one, value in zip(model.states, found, strict=True)}


@pytest.mark.parametrize(("age", "velocity"), [(0.0, 0.0), (0.6, 0.0), (0.6, 1.0), (0.6, -1.0)])
def test_it_ages_at_rest_and_is_forgotten_in_motion(age, velocity):
    own = AGEING.qualified({"height": 3.0, "time": 0.8})
    found = rates([AGEING], own, velocity=velocity, **{f"{AGEING.name}.age_0": age})
    expected = (1.0 - age) / 0.8 if velocity == 0.0 else -age / FORGOTTEN
    assert found[f"{AGEING.name}.age_0"] == pytest.approx(expected, rel=1e-6)


def test_the_level_is_as_much_higher_as_it_has_aged():
    values = grown("servo-pneumatic").values
    states = {"bristle": 1.0, "velocity": 0.3, f"{AGEING.name}.age_0": 0.5}
    own = AGEING.qualified({"height": 3.0, "time": 0.8})
    before, after = rates([], {}, **states), rates([AGEING], own, **states)
    more = (before["velocity"] - after["velocity"]) * values["payload_mass"]
    assert more == pytest.approx(values["coulomb_friction"] * 3.0 * 0.2 * 0.5, rel=1e-6)


def test_it_is_found_by_its_name_and_is_no_candidate():
    found = find_effect(AGEING.name, Path())
    assert (found.name, found.sites) == ("ageing@force.coulomb@velocity", ("force.coulomb",))
    assert not any(effect.name.startswith("ageing") for effect in admitted(build(servo_pneumatic)))
    assert AGEING.says == "a quantity that grows while velocity rests in {time} describes it"
