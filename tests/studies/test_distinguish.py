"""Distinguishability: twins stay together, what differs comes apart, and a recording shows what it can show."""

import numpy as np
import pytest

from studies import distinguish
from studies.distinguish import (
    DRAWN,
    NEEDED,
    SHARES,
    Looks,
    forms,
    inseparable,
    left_over,
    resized,
    searched,
    study,
    table,
)
from studies.trial.named import NAMED
from studies.trial.signatures import Sight, excited


def test_what_a_rival_spans_is_gone():
    rng = np.random.default_rng(0)
    rival = rng.normal(size=(200, 2))
    assert left_over(rival @ [1.0, -2.0], rival) < 1e-9
    own = rng.normal(size=200)
    assert 0.9 * np.linalg.norm(own) < left_over(own, rival) <= np.linalg.norm(own)
    assert left_over(own, np.zeros((200, 2))) == pytest.approx(np.linalg.norm(own))


@pytest.fixture(scope="module")
def sine():
    """A single sine, position only: where latencies are alike, and the ends are never met."""
    run = excited("sine", 1.3, np.random.default_rng(0))
    return table(
        [Sight(run, pressure_noise=None)], ["input_delay", "sensor_lag", "valve_offset", "end_cushioning"]
    )


def test_latencies_are_hard_to_tell_apart_and_an_offset_is_not(sine):
    assert sine["input_delay"]["sensor_lag"] > 10 * sine["input_delay"]["valve_offset"]
    assert sine["valve_offset"]["sensor_lag"] < 0.1


def test_cushioning_does_not_show_where_the_ends_are_not_met(sine):
    assert sine["end_cushioning"]["alone"] is None


def test_no_rival_makes_an_effect_easier_to_see(sine):
    for name in ("input_delay", "sensor_lag", "valve_offset"):
        rivals = [size for rival, size in sine[name].items() if rival != "alone"]
        assert min(rivals) >= sine[name]["alone"] * (1 - 1e-3)


@pytest.fixture(scope="module")
def steps():
    """Steps with pressures: a short look with every sensor."""
    return Looks([Sight(excited("steps", 1.3, np.random.default_rng(0)))])


def test_a_force_and_friction_that_is_stronger_one_way_are_the_same_thing(steps):
    names = ["constant_force", "asymmetric_friction", "spring_load", "cross_leakage"]
    rows = table(steps.projector.sights, names)
    assert inseparable({"rich": {"with pressures": rows}}) == [["asymmetric_friction", "constant_force"]]
    for one, other in (names[:2], names[1::-1]):  # either way, and though its drawn forms do not span it
        own = steps.signature(forms(one)[0])
        assert left_over(own, steps.forms(other)) > NEEDED
        assert searched(own, steps, other) < 1e-2


def test_a_search_finds_the_size_and_the_sign_of_what_is_there(steps):
    hidden = resized("valve_offset", 0, 0.777, flipped=True)
    own = steps.signature(hidden)
    assert hidden.fields["valve_offset"] * forms("valve_offset")[0].fields["valve_offset"] < 0.0
    assert searched(own, steps, "valve_offset") < 1e-3 * np.linalg.norm(own)


@pytest.mark.parametrize("name", NAMED)
def test_a_form_at_another_size_keeps_the_rest_of_its_draws(name):
    drawn = forms(name)
    for form in range(len(DRAWN)):
        assert resized(name, form, None) == drawn[form]
        weak, strong = (resized(name, form, share).fields for share in (SHARES[0], SHARES[-1]))
        assert weak.keys() == strong.keys() == drawn[form].fields.keys()
        assert weak != strong


def test_pairs_need_more_than_their_medium_size_to_be_inseparable():
    def rows(share):
        return {"rich": {"with pressures": {"a": {"alone": 0.1, "b": share}, "b": {"alone": 0.1, "a": 0.2}}}}

    assert inseparable(rows(1.5)) == [["a", "b"]]
    assert inseparable(rows(0.9)) == []
    assert inseparable({"rich": {"with pressures": {"a": {"alone": 2.0, "b": 3.0}}}}) == []


@pytest.mark.full
def test_the_study_covers_excitations_and_sensors(monkeypatch):
    monkeypatch.setattr(distinguish, "EXCITATIONS", {"sine": ("sine",)})
    found = study(1.3, ["valve_offset", "constant_force"])
    assert set(found["sine"]) == {"position only", "with pressures"}
    assert found["sine"]["with pressures"]["constant_force"]["alone"] < 0.5
