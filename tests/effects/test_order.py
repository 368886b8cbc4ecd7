"""Effects at a common site make the same model whichever of them was found first."""

import itertools
from functools import lru_cache

import numpy as np
import pytest

from optid.core.sheet import build
from optid.effects.library import built_in
from optid.rigs.rigfile import read_rig
from optid.rigs.servo_pneumatic import servo_pneumatic
from tests.effects.plants import DATA, RANGES

PARAMETERS = read_rig(DATA / "table1.toml").parameters
SITES = set(build(servo_pneumatic).sites)
EFFECTS = [effect for effect in built_in().values() if SITES.issuperset(effect.sites)]
PAIRS = [
    (one, other)
    for one, other in itertools.combinations(EFFECTS, 2)
    if set(one.sites) & set(other.sites) and other.name not in one.excludes and one.name not in other.excludes
]


@lru_cache(maxsize=8)
def built(effects):
    """The plant with these effects."""
    return build(servo_pneumatic, effects)


def numbers(effects, seed, values):
    """Rates and outputs by name, at random states and inputs, with these values of the effects' parameters."""
    model = built(effects)
    p = model.vector({**PARAMETERS, **values})

    def drawn(name, low, high):
        return np.random.default_rng([seed, *name.encode()]).uniform(low, high)

    x = np.array([drawn(s.name, *RANGES.get(s.name, (-2 * s.scale, 2 * s.scale))) for s in model.states])
    x = np.array([300.0 if s.unit == "K" else value for s, value in zip(model.states, x, strict=True)])
    x[0] = (x[0], 0.122, -0.122)[seed % 3]  # the ends of the stroke have laws of their own
    if seed % 2:  # as a recording begins
        x = np.array(
            [
                0.0 if "." in s.name and s.unit != "K" else value
                for s, value in zip(model.states, x, strict=True)
            ]
        )
    ranges = {"interval": (9e-4, 1e-3), "clock": (0.0, 20.0)}
    u = np.array([drawn(f"{q.role}@{q.ago}", *ranges.get(q.role, (-0.9, 0.9))) for q in model.inputs])
    rates = np.array(model.rates(x, u, p)).ravel()
    shown = np.array(model.sensors(x, u, p)).ravel()
    return dict(zip([s.name for s in model.states], rates, strict=True)) | dict(enumerate(shown))


@pytest.mark.parametrize(("one", "other"), PAIRS, ids=lambda e: e.name)
def test_two_effects_are_the_same_in_either_order(one, other):
    values = {name: value for e in (one, other) for name, value in e.qualified(e.usual[0]).items()}
    for seed in range(12):
        first, second = numbers((one, other), seed, values), numbers((other, one), seed, values)
        assert first == pytest.approx(second, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(("one", "other"), PAIRS, ids=lambda e: e.name)
def test_beside_another_an_effect_at_its_null_is_none(one, other):
    """What is fitted first must not move where the second is tried."""
    for given, null in ((one, other), (other, one)):
        own = given.qualified(given.usual[0])
        for seed in range(6):
            alone, both = numbers((given,), seed, own), numbers((given, null), seed, own)
            assert {name: both[name] for name in alone} == pytest.approx(alone, rel=1e-9, abs=1e-9), null.name
