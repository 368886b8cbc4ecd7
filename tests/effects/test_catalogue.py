"""What every effect of the catalogue states: names, texts, sizes; and what comes back from a rig file."""

import re
from pathlib import Path

import numpy as np
import pytest

from optid.core.axis import Axis
from optid.effects.anywhere import Anywhere
from optid.effects.effect import SIGNALS
from optid.effects.library import built_in
from optid.effects.sized import sized
from optid.rigs.rigfile import read_rig, with_effects, write_rig
from tests.effects.plants import DATA, MACHINES, grown

# The names that rig files and diagnoses rely on.
PROMISED = {
    "stribeck_friction",
    "asymmetric_friction",
    "constant_force",
    "position_dependent_friction",
    "spring_load",
    "quadratic_drag",
    "periodic_disturbance",
    "friction_drift",
    "end_cushioning",
    "compliant_load",
    "cross_leakage",
    "ambient_leakage",
    "heat_transfer",
    "critical_pressure_ratio",
    "supply_droop",
    "exhaust_restriction",
    "valve_deadband",
    "valve_offset",
    "valve_lag",
    "input_delay",
    "valve_hysteresis",
    "valve_saturation",
    "valve_underlap",
    "sensor_backlash",
    "sensor_lag",
    "sensor_nonlinearity",
    "sensor_drift",
    "presliding",
}
OF_OTHERS = {
    "cogging",
    "transmission_backlash",
    "transmission_compliance",
    "laminar_leakage",
    "turbulent_leakage",
    "air_in_oil",
    "viscosity_drift",
}
OTHERS = [e for name in ("rotary-axis", "servo-hydraulic") for e in grown(name).effects]
EFFECTS = [
    *grown("servo-pneumatic").effects,
    *(e for e in grown("cascaded-tanks").effects if not e.name.endswith(".outlet")),
    *(e for e in OTHERS if e.name in OF_OTHERS or e.name == "spring_load"),
]


def test_every_promised_name_is_there_and_acts_on_the_axis():
    acting = {effect.name for effect in grown("servo-pneumatic").effects}
    assert acting.issuperset(PROMISED)
    assert {effect.name for effect in EFFECTS if not isinstance(effect, Anywhere)} == set(built_in())


def test_what_only_other_machines_have_is_silent_on_the_pneumatic_axis():
    assert OF_OTHERS.isdisjoint(effect.name for effect in grown("servo-pneumatic").effects)
    assert {effect.name for effect in OTHERS} >= OF_OTHERS


def test_what_any_site_can_carry_is_offered_where_nothing_else_acts():
    assert not any(isinstance(effect, Anywhere) for effect in grown("servo-pneumatic").effects)
    free = {effect.site for effect in grown("emps").effects if isinstance(effect, Anywhere)}
    assert free == {"drive.command"}
    names = {effect.name for effect in grown("cascaded-tanks").effects}
    assert {"overflow", "saturation@flow.inlet", "delay@flow.command", "power_law@flow.outlet"} <= names
    assert not any(
        name.endswith(("@store.upper", "@store.lower")) for name in names
    )  # nothing flows there yet


@pytest.mark.parametrize("effect", EFFECTS, ids=repr)
def test_it_speaks_of_all_its_parameters_and_of_known_effects(effect):
    own = {q.name for q in effect.parameters}
    assert set(re.findall(r"\{(\w+)\}", effect.says)) == own
    assert effect.says.format(**dict.fromkeys(own, "1 mm"))
    assert set(effect.look_alikes) <= set(built_in()) - {effect.name}
    assert set(effect.shares) <= set(effect.strength)
    assert set(effect.shares.values()) <= set(effect.look_alikes)
    assert effect.depends_on and set(effect.depends_on) <= set(SIGNALS)
    assert all((effect.law, effect.experiment, effect.source, effect.equation, effect.needs, effect.__doc__))


@pytest.mark.parametrize("effect", EFFECTS, ids=repr)
def test_the_ranges_it_states_are_of_signals_that_it_follows(effect):
    for point in effect.usual:
        ranges = effect.active_range({**effect.at_null(), **point}, {"stroke": 0.26})
        assert set(ranges) <= set(effect.depends_on)
        assert all(low < high for low, high in ranges.values())


@pytest.mark.parametrize("effect", EFFECTS, ids=repr)
def test_its_usual_points_are_whole_admissible_and_worth_a_name(effect):
    bounds = {q.name: q.bounds for q in effect.parameters}
    assert set(effect.strength) <= set(bounds)
    for point in effect.usual:
        assert set(point) == set(bounds), point
        assert all(low <= point[name] <= high for name, (low, high) in bounds.items()), point
        assert 1.5 < effect.size(point) <= 200.0, point
    assert effect.size(effect.at_null()) == 0.0


@pytest.mark.parametrize("effect", EFFECTS, ids=repr)
def test_a_strength_of_either_sign_is_tried_on_both_sides(effect):
    for q in effect.parameters:
        if q.name in effect.strength and q.bounds[0] < q.default < q.bounds[1]:
            tried = {(point[q.name] > q.default) - (point[q.name] < q.default) for point in effect.usual}
            assert {-1, 1} <= tried, q.name


@pytest.mark.parametrize("name", MACHINES)
def test_a_rig_file_keeps_every_effect(name, tmp_path: Path):
    rig, effects = read_rig(DATA / MACHINES[name][1]), grown(name).effects
    values = {}
    for effect in effects:  # numbers that only their shortest decimal texts give back
        inside = {
            q.name: np.clip(effect.usual[-1][q.name] * (1 - 1e-3 / 3), *q.bounds) for q in effect.parameters
        }
        values |= effect.qualified({key: float(value) for key, value in inside.items()})
    improved = with_effects(rig, effects, values)
    write_rig(improved, tmp_path / "rig.toml", values)
    again = read_rig(tmp_path / "rig.toml")
    assert [effect.name for effect in again.effects] == [effect.name for effect in effects]
    assert again.parameters == pytest.approx({**rig.parameters, **values}, rel=1e-12)


@pytest.mark.parametrize("before", [0, 100], ids=["whole", "after a stretch too short to hear it"])
def test_a_periodic_disturbance_is_tried_where_the_recordings_ring(before):
    rng, interval = np.random.default_rng(3), 1e-3
    t = np.arange(8000) * interval
    heard = [0.1 * np.sin(2 * np.pi * 7.3 * t + phase) + rng.normal(size=8000) for phase in (0.4, 2.0)]
    heard[0][100:130] = np.nan
    heard = [*([rng.normal(size=before)] if before else []), *heard]
    points = built_in()["periodic_disturbance"].tries(heard, interval)
    nearest = min(points, key=lambda point: abs(point["frequency"] - 7.3))
    assert nearest["frequency"] == pytest.approx(7.3, abs=0.5 / t[-1])
    assert len({point["phase"] for point in points if point["frequency"] == nearest["frequency"]}) == 4
    other = built_in()["spring_load"]
    assert other.tries(heard, interval) == other.usual


def test_the_range_of_a_law_is_scaled_to_the_axis():
    """A joint of 2 rad and 5 N m: speeds are twenty times the slide's, as are the places of its stops."""
    joint = Axis("rad", 2.0, "N m", 5.0)
    slide, turning = (by(built_in()["stribeck_friction"]) for by in (lambda e: e, lambda e: sized(e, joint)))
    ranges = [law.active_range({**law.at_null(), **law.usual[0]}, {})["velocity"] for law in (slide, turning)]
    assert ranges[1] == pytest.approx([20.0 * end for end in ranges[0]])
