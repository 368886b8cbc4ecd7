"""Descriptions that swell with the magnitude of another signal: their forms, words, and that rig files hold them."""

from pathlib import Path

import numpy as np
import pytest

from optid.core.sheet import build
from optid.effects.curve import HEIGHTS, Curve, Scaling
from optid.effects.library import find_effect
from optid.effects.relaxation import Relaxation
from optid.effects.wave import KNOTS, Wave
from optid.rigs.emps import emps
from optid.rigs.rigfile import read_rig, with_effects, write_rig
from optid.rigs.servo_pneumatic import servo_pneumatic
from tests.effects.plants import grown

BOTH = "flow.chamber_a+flow.chamber_b"
EMPS = Path(__file__).parents[2] / "data" / "emps.toml"


def axis_rates(effects, own, **states):
    """Of the axis, by state, elsewhere at rest with 3 bar on either side."""
    model = build(servo_pneumatic, effects)
    usual = {"pressure_a": 3e5, "pressure_b": 3e5, **states}
    x = [usual.get(one.name, 0.0) for one in model.states]
    p = model.vector({**grown("servo-pneumatic").values, **own})
    found = model.rates(x, [0.3] + [0.0] * (len(model.inputs) - 1), p)
    return {one.name: float(value) for one, value in zip(model.states, np.array(found).ravel(), strict=True)}


def pushed(effect, own, **states):
    """What an effect adds to the force on EMPS, N."""
    plain = read_rig(EMPS)
    full = with_effects(plain, [effect], effect.qualified(own))
    rates = []
    for rig in (full, plain):
        x = [states.get(one.name, 0.0) for one in rig.model.states]
        u = [0.0] * len(rig.model.inputs)
        row = [one.name for one in rig.model.states].index("velocity")
        rates.append(float(rig.model.rates(x, u, rig.model.vector(rig.parameters))[row]))
    return (rates[0] - rates[1]) * plain.parameters["mass"]


def test_a_relaxation_swells_with_each_site_s_own_signal():
    plain = Relaxation(BOTH, "P", size=1e-4, scale=1e5, start=3e5)
    swelled = plain.swelling("P", 4e5)
    assert swelled.name == f"relaxation@{BOTH}@P*P"
    states = {"pressure_a": 4.4e5, "pressure_b": 2.5e5}
    none = axis_rates([], {}, **states)
    changes = [
        {
            name: value - none[name]
            for name, value in axis_rates([one], one.qualified({"height": 2.0}), **states).items()
            if name in none
        }
        for one in (swelled, plain)
    ]
    for name, pressure in states.items():
        assert changes[0][name] == pytest.approx(changes[1][name] * pressure / 4e5, rel=1e-6)


def test_a_share_of_dry_friction_swells_with_what_drives():
    share = Scaling("force.coulomb", "position", low=-0.1, high=0.1, size=0.5).swelling("drive", 80.0)
    values = grown("servo-pneumatic").values
    own = {f"{share.name}.height_{k + 1}": 1.0 for k in range(HEIGHTS)}  # a level curve of height 1
    states = {"pressure_a": 3.4e5, "pressure_b": 3.1e5, "velocity": 0.2, "bristle": 1.0}
    after, before = axis_rates([share], own, **states), axis_rates([], {}, **states)
    area = np.pi / 4 * values["bore_diameter"] ** 2
    rod = np.pi / 4 * values["rod_diameter"] ** 2
    drive = area * 3.4e5 - (area - rod) * 3.1e5 - rod * values["atmospheric_pressure"]
    more = values["coulomb_friction"] * 0.5 * abs(drive) / 80.0
    assert (before["velocity"] - after["velocity"]) * values["payload_mass"] == pytest.approx(more, rel=1e-6)


@pytest.mark.parametrize("velocity", [0.0, 0.06, -0.11, 0.2, -0.9])
def test_a_wave_has_a_height_for_every_magnitude_of_what_it_changes_with(velocity):
    wave = Wave("force.external", "position", size=40.0, repeats=5.0).swelling("velocity", 0.1)
    heights = np.random.default_rng(3).normal(size=len(KNOTS))
    own = {f"height_{k + 1}": h for k, h in enumerate(heights)} | {"phase": 0.4}
    height = np.interp(abs(velocity), np.array(KNOTS) * 0.1, heights)
    expected = 40.0 * height * np.sin(2 * np.pi * 5.0 * 0.13 + 0.4)
    assert pushed(wave, own, position=0.13, velocity=velocity) == pytest.approx(expected, rel=1e-9)


def test_in_proportion_a_wave_s_heights_grow_with_what_it_changes_with():
    wave = Wave("force.external", "position").swelling("velocity", 0.1)
    assert list(wave.of_height(0.7).values()) == pytest.approx([0.7 * knot for knot in KNOTS])
    assert Wave("force.external", "position").of_height(0.7) == {"height": 0.7}


def test_a_curve_turns_with_a_speed_and_swells_with_another_signal():
    curve = Curve("force.external", "position", "velocity", low=-0.2, high=0.6, size=40.0, width=0.02)
    own = {f"height_{k + 1}": 1.0 for k in range(HEIGHTS)}
    states = {"position": 0.1, "velocity": -0.3}
    swelled = curve.swelling("position", 0.2)
    assert swelled.name == "curve@force.external@position*position@velocity"
    assert swelled.depends_on == ("position", "velocity")
    assert pushed(swelled, own, **states) == pytest.approx(0.5 * pushed(curve, own, **states), rel=1e-9)


def test_turned_it_is_drawn_over_what_it_swelled_with():
    curve = Curve("force.external", "position", low=-0.2, high=0.6, size=40.0).swelling("velocity", 0.1)
    other = curve.turned(-0.5, 0.5, 0.3)
    assert other.name == "curve@force.external@velocity*position"
    null = other.at_null()
    assert [null[name] for name in ("low", "high", "size", "magnitude")] == [-0.5, 0.5, 40.0, 0.3]


@pytest.mark.parametrize(
    "effect",
    [
        Curve("force.external", "position", "velocity", low=-0.2, high=0.6, width=0.02).swelling(
            "position", 0.2
        ),
        Relaxation("force.external", "velocity", scale=0.2).swelling("position", 0.1),
        Wave("force.external", "time", repeats=3.0).swelling("velocity", 0.1),
    ],
)
def test_a_rig_file_holds_it_by_its_name(effect, tmp_path):
    assert find_effect(effect.name, Path()).name == effect.name
    rig = with_effects(read_rig(EMPS), [effect], {})
    values = {
        q.name: float(v) for q, v in zip(rig.model.parameters, rig.model.vector(rig.parameters), strict=True)
    }
    write_rig(rig, tmp_path / "rig.toml", values)
    again = read_rig(tmp_path / "rig.toml")
    assert [one.name for one in again.effects] == [effect.name]
    assert again.model.vector(again.parameters) == pytest.approx(rig.model.vector(rig.parameters), rel=1e-11)


def test_its_words_name_both_signals():
    share = Scaling("force.coulomb", "position").swelling("drive", 80.0)
    assert share.says == "a share over position, in proportion to the magnitude of drive, describes it"
    memory = Relaxation(BOTH, "P").swelling("P", 4e5)
    assert "decays in {time}, in proportion to the magnitude of P, describes it" in memory.says
    wave = Wave("force.external", "position").swelling("velocity", 0.1)
    assert wave.says == (
        "a wave over position with {repeats} periods in its SI unit, "
        "higher or lower with the magnitude of velocity, describes it"
    )
    assert build(emps, [wave]).name == build(emps).name
