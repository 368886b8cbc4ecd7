"""Rig files: read into SI, written back with comments, units and layout kept."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from malformed import RIG

from optid.core.readers import read_recording
from optid.errors import RigError
from optid.rigs import BUILT_IN, find_plant
from optid.rigs.rigfile import Freed, read_rig, write_rig

AXIS = """
from optid.core.parameter import Parameter

def axis(s, *, fast=False):
    x = s.state("x", "m", 1.0)
    tau = s.param(Parameter("tau", "s", 1.0, "lag", "test", bounds=(0.0, 1e9)))
    s.rate(x, (s.input("u", "V") - x) / (tau / 2 if fast else tau))
    s.output("y", "m", x)
"""
AXIS_RIG = """
model = "plants/axis.py:axis"
[options]
fast = true
[parameters]
tau = "20 ms"
[channels]
rate = "1 kHz"
u = { column = "u", unit = "mV" }
y = { column = "y", unit = "mm" }
"""


def save(folder, text=RIG, name="bench.toml"):
    (folder / name).write_text(text, encoding="utf-8")
    return read_rig(folder / name)


def test_contract_example_reads_into_si(tmp_path):
    rig = save(tmp_path)
    assert (rig.name, rig.model_name, rig.model.name) == ("bench-3", "servo-pneumatic", "servo-pneumatic")
    assert rig.parameters["supply_pressure"] == 7e5
    assert rig.parameters["port_width"] == 0.0062
    assert "gas_constant" not in rig.parameters  # only what the file states
    assert rig.model.vector(rig.parameters)[rig.model.index("gas_constant")] == 287.0
    assert rig.freed == (
        Freed("discharge_coefficient", 0.4, 1.0),
        Freed("viscous_friction", 0.0, 400.0, 50.0),
    )
    assert list(rig.channels) == ["time", "command", "position"]


def test_gauge_pressures_count_from_the_atmosphere(tmp_path):
    text = RIG.replace('"7 bar"', '"6 bar_gauge"').replace('atmospheric_pressure = "1 bar"\n', "")
    rig = save(tmp_path, text.replace("[fit]", 'atmospheric_pressure = "1013 hPa"\n[fit]'))
    assert rig.parameters["supply_pressure"] == pytest.approx(7.013e5)


def test_options_reach_the_plant(tmp_path):
    assert len(save(tmp_path).model.states) == 5
    text = RIG.replace("[parameters]", '[options]\nfriction = "smooth"\nrod_force = false\n\n[parameters]')
    rig = save(tmp_path, text)
    assert len(rig.model.states) == 4
    assert rig.options == {"friction": "smooth", "rod_force": False}


def test_own_plant_is_found_beside_the_rig_file(tmp_path):
    (tmp_path / "plants").mkdir()
    (tmp_path / "plants" / "axis.py").write_text(AXIS)
    rig = save(tmp_path, AXIS_RIG)
    assert rig.name == "bench"  # no name in the file: the file's own
    assert rig.parameters == {"tau": 0.02}
    assert rig.channels["u"].factor == pytest.approx(1e-3)
    # Written elsewhere, the plant goes with the file.
    (tmp_path / "out").mkdir()
    write_rig(rig, tmp_path / "out" / "rig.toml", {"tau": 0.03})
    again = read_rig(tmp_path / "out" / "rig.toml")
    assert again.model_name == "axis.py:axis"
    assert again.parameters == {"tau": 0.03}


@pytest.mark.parametrize("name", BUILT_IN)
def test_built_in_plants_load(name):
    assert callable(find_plant(name, Path()))


def test_written_file_keeps_comments_units_and_layout(tmp_path):
    text = RIG.replace('payload_mass = "1.9 kg"', 'payload_mass = "1.9 kg"   # weighed in May')
    text = "# Bench in hall 3\n" + text.replace("[fit]", "# what may move\n[fit]")
    rig = save(tmp_path, text)
    write_rig(
        rig, tmp_path / "new.toml", {"payload_mass": 2.25, "stroke": 0.25, "discharge_coefficient": 0.7}
    )
    expected = text.replace('"1.9 kg"', '"2.25 kg"').replace('"260 mm"', '"250.0 mm"').replace("0.8", "0.7")
    assert (tmp_path / "new.toml").read_text() == expected


def test_written_without_new_values_is_the_same_text(tmp_path):
    rig = save(tmp_path)
    write_rig(rig, tmp_path / "new.toml", dict(rig.parameters))
    assert (tmp_path / "new.toml").read_text() == RIG


def test_parameters_the_file_did_not_state_are_added_in_si(tmp_path):
    write_rig(save(tmp_path), tmp_path / "new.toml", {"stop_damping": 3.0, "flow_width": 0.001})
    again = read_rig(tmp_path / "new.toml")
    assert again.parameters["stop_damping"] == 3.0
    assert again.parameters["flow_width"] == 0.001
    assert 'stop_damping = "3.0 s/m"' in (tmp_path / "new.toml").read_text()


def test_moving_the_atmosphere_moves_no_other_pressure(tmp_path):
    text = RIG.replace('supply_pressure = "7 bar"', 'supply_pressure = "6 bar_gauge"')
    text = text.replace("[channels]", 'supply_pressure = { bounds = ["5 bar_gauge", "8 bar"] }\n\n[channels]')
    rig = save(tmp_path, text)
    write_rig(rig, tmp_path / "new.toml", {"atmospheric_pressure": 0.9e5})
    again = read_rig(tmp_path / "new.toml")
    assert again.parameters["supply_pressure"] == pytest.approx(7e5, rel=1e-12)
    assert again.freed[-1].low == pytest.approx(6e5, rel=1e-12)
    assert again.freed[-1].high == 8e5


def test_fitted_value_on_its_bound_reads_back(tmp_path):
    text = RIG.replace("[fit]", '[fit]\nresidual_length = { bounds = ["1.1 cm", "40 mm"] }')
    rig = save(tmp_path, text)
    for bound in (rig.freed[0].low, rig.freed[0].high):
        write_rig(rig, tmp_path / "new.toml", {"residual_length": bound})
        assert read_rig(tmp_path / "new.toml").parameters["residual_length"] == bound


@pytest.mark.parametrize(
    ("values", "fragments"),
    [
        ({"payload_mas": 2.0}, ("payload_mas", '"payload_mass"')),
        ({"payload_mass": -1.0}, ("parameters.payload_mass", "physical")),
        ({"payload_mass": float("nan")}, ("parameters.payload_mass", "finite")),
        ({"discharge_coefficient": 3.0}, ("fit.discharge_coefficient", "bounds")),
    ],
)
def test_refused_values_leave_no_file(values, fragments, tmp_path):
    rig = save(tmp_path)
    with pytest.raises(RigError) as caught:
        write_rig(rig, tmp_path / "new.toml", values)
    assert all(fragment in str(caught.value) for fragment in fragments)
    assert os.listdir(tmp_path) == ["bench.toml"]  # noqa: PTH208


def test_failed_write_keeps_the_old_file(tmp_path, monkeypatch):
    rig = save(tmp_path)

    def full(_):
        raise OSError("No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(RigError, match="No space left"):
        write_rig(rig, rig.path, {"stroke": 0.2})
    assert [path.name for path in tmp_path.iterdir()] == ["bench.toml"]
    assert rig.path.read_text() == RIG


def test_write_into_a_missing_folder_is_named(tmp_path):
    with pytest.raises(RigError, match="cannot be written"):
        write_rig(save(tmp_path), tmp_path / "no" / "rig.toml")


UNITS = {
    "supply_pressure": ("7 bar", "101.5 psi", "700 kPa", "6 bar_gauge"),
    "stroke": ("260 mm", "0.26 m", "10.2 inch"),
    "viscous_friction": ("78 N s/m", "0.078 N s/mm"),
    "supply_temperature": ("293 K", "20 degC"),
    "specific_heat_ratio": ("1.4", "140 %"),
}


@settings(max_examples=40, deadline=None)
@given(
    units=st.fixed_dictionaries({name: st.sampled_from(choices) for name, choices in UNITS.items()}),
    values=st.fixed_dictionaries(
        {},
        optional={
            "supply_pressure": st.floats(2e5, 1e7),
            "stroke": st.floats(1e-6, 1e3),
            "viscous_friction": st.floats(0.0, 400.0, allow_subnormal=False),
            "supply_temperature": st.floats(150.0, 1000.0),
            "specific_heat_ratio": st.floats(1.001, 1.69),
            "coulomb_friction": st.floats(0.0, 130.0),  # what 2 bar overcome
        },
    ),
)
def test_any_values_in_any_units_read_back(tmp_path_factory, units, values):
    folder = tmp_path_factory.mktemp("rig")
    text = RIG.replace('supply_pressure = "7 bar"\n', "").replace('stroke = "260 mm"\n', "")
    text = text.replace('viscous_friction = "78 N s/m"\n', "")
    stated = "\n".join(f'{name} = "{value}"' for name, value in units.items())
    rig = save(folder, text.replace("[parameters]", f"[parameters]\n{stated}"))
    write_rig(rig, folder / "new.toml", values)
    again = read_rig(folder / "new.toml")
    wanted = {**rig.parameters, **values}
    assert again.parameters.keys() == wanted.keys()
    np.testing.assert_allclose([again.parameters[name] for name in wanted], list(wanted.values()), rtol=1e-12)
    assert again.freed == rig.freed
    assert again.channels == rig.channels


def test_an_input_may_go_on_straight_between_its_samples(tmp_path):
    (tmp_path / "plants").mkdir()
    (tmp_path / "plants" / "axis.py").write_text(AXIS)
    file = tmp_path / "run.csv"
    file.write_text("u,y\n" + "\n".join(f"{k * k},{k}" for k in range(20)))
    held = save(tmp_path, AXIS_RIG)
    stated = AXIS_RIG.replace('unit = "mV" }', 'unit = "mV", between = "linear" }')
    straight = save(tmp_path, stated)
    u = read_recording(file, held)["u"].values
    assert read_recording(file, straight)["u"].values == pytest.approx([*((u[:-1] + u[1:]) / 2), u[-1]])
    write_rig(straight, tmp_path / "again.toml", {"tau": 0.03})
    assert read_rig(tmp_path / "again.toml").channels["u"].linear
    for wrong in (
        stated.replace('"linear"', '"spline"'),
        AXIS_RIG.replace('unit = "mm" }', 'unit = "mm", between = "held" }'),
    ):
        with pytest.raises(RigError, match="between"):
            save(tmp_path, wrong)
