"""A plant of a user's own takes one file of thirty lines and public names only."""

import ast
import shutil
from pathlib import Path

import optid
from optid.effects.library import admitted
from optid.rigs.rigfile import read_rig

PLANT = Path(__file__).parents[2] / "studies" / "docs" / "own" / "servo.py"
RIG = """
model = "servo.py:servo"
[parameters]
torque_constant = "0.39 N m/A"
resistance = "4 V/A"
armature = "0.0018 kg m**2"
mass = "0.49 kg"
length = "0.1 m"
viscous_friction = "0.004 N m s/rad"
coulomb_friction = "0.013 N m"
[fit]
viscous_friction = { bounds = ["0 N m s/rad", "0.1 N m s/rad"] }
coulomb_friction = { bounds = ["0 N m", "0.2 N m"] }
[channels]
time = { column = "t", unit = "s" }
goal = { column = "goal", unit = "rad" }
gain = { column = "kp", unit = "1" }
enable = { column = "on", unit = "1" }
position = { column = "q", unit = "rad" }
"""


def test_it_takes_thirty_lines_and_no_private_name():
    text = PLANT.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 30
    modules = {node.module for node in ast.walk(ast.parse(text)) if isinstance(node, ast.ImportFrom)}
    assert modules == {"optid", "optid.laws"}
    assert {"Parameter", "Sheet"} <= set(optid.__all__)


def test_its_friction_is_a_torque_and_its_effects_are_a_joints(tmp_path):
    shutil.copy(PLANT, tmp_path)
    (tmp_path / "rig.toml").write_text(RIG)
    rig = read_rig(tmp_path / "rig.toml")
    units = {q.name: q.unit for q in rig.model.parameters}
    assert units["coulomb_friction"] == "N m" and units["presliding_length"] == "rad"
    assert rig.parameters["coulomb_friction"] == 0.013


def test_effects_of_a_joint_that_states_no_axis_have_its_units(tmp_path):
    text = PLANT.read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if "s.axis(" not in line]
    assert len(lines) < len(text.splitlines())
    (tmp_path / "servo.py").write_text("\n".join(lines))
    (tmp_path / "rig.toml").write_text(RIG.replace('N m"', 'N"'))  # its friction law is a slide's
    model = read_rig(tmp_path / "rig.toml").model
    (bump,) = (one for one in admitted(model) if one.name == "position_dependent_friction")
    units = {q.name: q.unit for q in bump.parameters}
    assert units["place"] == units["width"] == "rad" and units["slope_ahead"] == "1/rad"
    assert {q.name: q.typical for q in bump.parameters}["width"] == 0.03  # nothing is known of its size


def test_it_runs_along_a_recorded_servo(tmp_path, shared):
    shutil.copy(PLANT, tmp_path)
    (tmp_path / "rig.toml").write_text(RIG)
    run = optid.simulate(tmp_path / "rig.toml", shared / "recordings" / "xl330" / "sin_sin_400.csv")
    assert run.document["position"]["window"]["fit_percent"] > 80.0
