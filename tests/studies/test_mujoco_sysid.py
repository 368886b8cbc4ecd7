"""MuJoCo's identification, where it is installed: the arm it is given is the rotary axis of the rig file."""

import numpy as np
import pytest

from optid.rigs.rigfile import read_rig
from studies import mujoco_sysid
from studies.independent_axes import Rotary
from studies.mujoco_sysid import OWN, RIG, by_mujoco, line, recorded
from studies.peers import fit_mujoco


def test_a_row_marks_what_its_interval_misses():
    arm = Rotary()
    found = {name: (getattr(arm, own), 1e-9) for name, own in OWN.items()}
    assert "!" not in line("one", (1.0, 2.0), found, arm)
    found["payload_mass"] = (arm.mass * 1.02, 0.01 * arm.mass)
    assert line("one", (1.0, 2.0), found, arm).count("2.00!") == 1


def test_without_mujoco_it_says_how_to_install_it(monkeypatch, capsys):
    monkeypatch.setattr(fit_mujoco, "available", lambda: False)
    monkeypatch.setattr("sys.argv", ["mujoco_sysid.py"])
    assert mujoco_sysid.main() == 1
    assert "pip install" in capsys.readouterr().out


@pytest.mark.skipif(not fit_mujoco.available(), reason="needs mujoco[sysid]")
@pytest.mark.filterwarnings("ignore")  # its own
def test_it_finds_the_arm_to_what_its_soft_friction_allows():
    arm, rig = Rotary(mass=0.45, viscous=0.06, coulomb=0.1), read_rig(RIG)
    found = by_mujoco(rig, recorded(arm, 1.5, np.random.default_rng(2), rig))
    assert found["payload_mass"][0] == pytest.approx(0.45, rel=0.02)
    assert found["coulomb_friction"][0] == pytest.approx(0.1, rel=0.1)
