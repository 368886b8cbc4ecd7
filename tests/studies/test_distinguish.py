"""Distinguishability: twins stay together, what differs comes apart, and a recording shows what it can show."""

import numpy as np
import pytest

from studies import distinguish
from studies.distinguish import inseparable, left_over, study, table
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


def test_pairs_need_more_than_their_medium_size_to_be_inseparable():
    def rows(share):
        return {"rich": {"with pressures": {"a": {"alone": 0.1, "b": share}, "b": {"alone": 0.1, "a": 0.2}}}}

    assert inseparable(rows(1.5)) == [["a", "b"]]
    assert inseparable(rows(0.9)) == []
    assert inseparable({"rich": {"with pressures": {"a": {"alone": 2.0, "b": 3.0}}}}) == []


def test_the_study_covers_excitations_and_sensors(monkeypatch):
    monkeypatch.setattr(distinguish, "EXCITATIONS", {"sine": ("sine",)})
    found = study(1.3, ["valve_offset", "constant_force"])
    assert set(found["sine"]) == {"position only", "with pressures"}
    assert found["sine"]["with pressures"]["constant_force"]["alone"] < 0.5
