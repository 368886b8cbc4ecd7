"""The test of a night: what the independent rig has, one step puts there."""

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from optid.cli import cli
from optid.errors import InputError
from optid.estimation import multistep
from optid.fleet.night import night_test, quantities
from optid.rigs.rigfile import read_rig
from studies.plant.nights import ROOT, SUPPLY, Plant, Wear, night, sound, wear_of

WATCH = ("cross_leakage", "valve_deadband")
PLANT = Plant(rigs=4, nights=10, wearing=2, begins=(0, 0), seconds=6.0)


def fitted(number):
    """The rig file with the rig's true numbers, which a fit would find; its friction yields as a stiff one."""
    rig, true = read_rig(ROOT / "data" / "bench.toml"), sound(PLANT, number)
    values = {
        "viscous_friction": true.viscous,
        "coulomb_friction": true.coulomb,
        "discharge_coefficient": true.discharge,
        "residual_length": true.residual_length,
        "presliding_length": 2e-6,
        "presliding_shape": 1.0,
    }
    return replace(rig, parameters={**rig.parameters, **values})


@pytest.mark.full
def test_a_sound_rig_has_nothing_of_what_is_watched():
    assert wear_of(PLANT, 3) is None
    found = quantities(fitted(3), [night(PLANT, 3, 4)], WATCH)
    assert abs(found["cross_leakage.area"].value) < 5e-9
    assert abs(found["valve_deadband.width"].value) < 2e-4
    true = sound(PLANT, 3)
    assert found["coulomb_friction"].value == pytest.approx(true.coulomb, rel=0.08)  # it wanders by night
    assert found["discharge_coefficient"].value == pytest.approx(true.discharge, rel=0.02)


@pytest.mark.full
def test_wear_is_measured_as_it_grows():
    wear, _ = wear_of(PLANT, 1)
    assert wear.effect == "valve_deadband"
    sizes = [
        quantities(fitted(1), [night(PLANT, 1, n)], WATCH)["valve_deadband.width"].value for n in (0, 1, 2)
    ]
    true = [wear.medium * (n + 1) / 12.0 for n in (0, 1, 2)]
    assert sizes == pytest.approx(true, rel=0.4)


def test_a_livelier_filter_measures_a_night_that_the_quiet_one_loses(monkeypatch):
    """It diverges on about one night of 3 000, where the model sticks and its rig creeps."""

    def lost(q, p, level=multistep.QUIET):
        return None if level == multistep.QUIET else quiet_filter(q, p, level)

    quiet_filter = multistep.quiet_filter
    monkeypatch.setattr(multistep, "quiet_filter", lost)
    found = quantities(fitted(3), [night(PLANT, 3, 4)], ())
    assert found["discharge_coefficient"].value == pytest.approx(sound(PLANT, 3).discharge, rel=0.02)
    assert found["coulomb_friction"].value == pytest.approx(sound(PLANT, 3).coulomb, rel=0.08)


def test_what_moves_from_day_to_day_is_followed_too():
    """Supply pressure that is not told to be free: else every night's flow would seem to have changed."""
    found = [quantities(fitted(3), [night(PLANT, 3, n)], ()) for n in range(6)]
    pressures = np.array([one["supply_pressure"].value for one in found])
    assert np.std(pressures) == pytest.approx(SUPPLY * 7e5, rel=0.6)
    lengths = np.array([one["residual_length"].value for one in found])
    assert np.std(lengths) < 2e-4  # m; 6e-4 where the pressure is held


def test_wears_are_of_the_atlas():
    assert 0.0 < Wear("cross_leakage", 1e-7).visible < 0.1


def test_unknown_effects_are_refused(tmp_path):
    with pytest.raises(InputError, match="did you mean"):
        night_test(ROOT / "data" / "bench.toml", [ROOT / "data" / "bench.csv"], watch=["valve_deadbnd"])


def test_the_command_writes_what_it_measured(tmp_path):
    call = ["fleet", "test", str(ROOT / "data" / "bench.toml"), str(ROOT / "data" / "bench.csv")]
    ran = CliRunner().invoke(cli, [*call, "--watch", "valve_deadband", "--out", str(tmp_path / "out")])
    assert ran.exit_code == 0, ran.output
    document = json.loads((tmp_path / "out" / "test.json").read_text())
    assert document["schema"] == "optid.test/1"
    one = document["quantities"]["valve_deadband.width"]
    assert one["ci95"][0] < one["value"] < one["ci95"][1]
    assert any(name.endswith("bench.csv") for name in document["inputs"])
