"""All quantities of a rig tested together, in the directions that nights wander in."""

import numpy as np
import pandas as pd
import pytest

from optid.fleet.statistics.joint import joint
from optid.fleet.statistics.normal_scores import LOOKS

RIGS, NIGHTS, REFERENCE, QUANTITIES = 40, 19, 7, 6


@pytest.fixture
def nightly():
    """Two wanders that move all quantities, much larger than what else they scatter by; none has changed."""
    rng = np.random.default_rng(3)
    ways = rng.normal(size=(2, QUANTITIES))
    level = rng.normal(size=(RIGS, 1, QUANTITIES))
    size = np.exp(0.3 * rng.normal(size=(RIGS, 1, 1)))
    wander = rng.normal(size=(RIGS, NIGHTS, 2)) @ ways
    return level + size * (wander + 0.1 * rng.normal(size=(RIGS, NIGHTS, QUANTITIES)))


def table(values):
    names = [[f"q{k}" for k in range(QUANTITIES)], [f"rig-{k:02}" for k in range(RIGS)], range(NIGHTS)]
    index = pd.MultiIndex.from_product(names, names=["quantity", "rig", "date"])
    return pd.DataFrame({"value": np.moveaxis(values, 2, 0).ravel()}, index=index)


def test_sound_nights_have_p_values_that_hold(nightly):
    p = joint(table(nightly), REFERENCE)
    assert len(p) == RIGS * (NIGHTS - REFERENCE - LOOKS[0] + 1)
    assert (p["p"] < 0.05).mean() < 0.05
    assert p["p"].min() > 1e-4


def test_a_change_that_wander_hides_in_each_quantity_is_seen_in_all(nightly):
    moved = 0.5 * np.ones(QUANTITIES)
    alone = moved / np.std(
        nightly[:, :REFERENCE] - nightly[:, :REFERENCE].mean(axis=1, keepdims=True), axis=(0, 1)
    )
    assert np.abs(alone).max() < 2.0  # sd of a night
    nightly[5, REFERENCE + 3 :] += moved
    p = joint(table(nightly), REFERENCE).set_index(["rig", "date"])["p"]
    assert p["rig-05"].loc[REFERENCE + 6 :].max() < 1e-5
    assert p.drop("rig-05", level="rig").min() > 1e-5


def test_one_night_that_went_wrong_is_no_change(nightly):
    nightly[5, REFERENCE + 3] += 50.0
    p = joint(table(nightly), REFERENCE).set_index(["rig", "date"])["p"]
    assert p["rig-05"].min() > 1e-3


def test_a_rig_that_lacks_a_quantity_and_a_fleet_too_small_say_nothing(nightly):
    values = table(nightly)
    less = joint(values.drop(("q0", "rig-05", 3)), REFERENCE)
    assert "rig-05" not in set(less["rig"])
    few = values[values.index.get_level_values("rig") < "rig-02"]
    assert joint(few, REFERENCE).empty


def test_a_sibling_s_wild_night_hides_no_change(nightly):
    """The wander is learnt from the reference nights of all rigs: one that went wrong must not set its size."""
    nightly[5, REFERENCE + 3 :] += 0.5
    nightly[9, 2] += 500.0 * np.arange(QUANTITIES)
    p = joint(table(nightly), REFERENCE).set_index(["rig", "date"])["p"]
    assert p["rig-05"].loc[REFERENCE + 6 :].max() < 1e-3


def test_few_rigs_are_judged_as_many_are():
    """A rig that took part in its own whitening would have a reference nearer than its later nights."""
    rng = np.random.default_rng(8)
    names = [[f"q{k}" for k in range(QUANTITIES)], [f"rig-{k}" for k in range(4)], range(NIGHTS)]
    index = pd.MultiIndex.from_product(names, names=["quantity", "rig", "date"])
    p = [
        joint(pd.DataFrame({"value": rng.normal(size=len(index))}, index=index), REFERENCE)["p"]
        for _ in range(60)
    ]
    assert (pd.concat(p) < 0.01).mean() < 0.01
