"""The real recordings are cut into parts that do not overlap, and the hanging cylinder obeys its equation."""

import sys
from pathlib import Path

import numpy as np
import pytest

from optid.core.readers import read_recording
from optid.rigs.rigfile import read_rig
from studies import real_recordings
from studies.real_recordings import CASES, main

STUDIES = Path(real_recordings.__file__).parent


def test_the_cylinder_is_lifted_by_what_pressure_leaves_over_weight_and_friction():
    rig = read_rig(STUDIES / "hanging_cylinder.toml")
    p = rig.model.vector(rig.parameters)
    names = [state.name for state in rig.model.states]
    x = np.zeros(len(names))
    x[names.index("velocity")], x[names.index("bristle")] = 0.4, 1.0  # sliding upwards
    rates = np.array(rig.model.rates(x, [3e5], p)).ravel()
    force = 2e5 * 490.9e-6 - 1.469 * 9.81 - 50.0 * 0.4 - 5.0
    assert rates[names.index("velocity")] == pytest.approx(force / 1.469, rel=1e-9)
    assert rates[names.index("position")] == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("name", "lengths"), [("emps", (24821, 24821)), ("pneumatic_cylinder", (6400, 3600))]
)
def test_parts_in_time_do_not_overlap(shared, name, lengths):
    parts = CASES[name].parts()
    assert (len(parts["train"]), len(parts["holdout"])) == lengths
    if name == "pneumatic_cylinder":
        assert parts["train"]["t"].max() < parts["holdout"]["t"].min()


def test_the_tanks_parts_are_the_two_records(shared):
    train, held = (CASES["cascaded_tanks"].parts()[part] for part in ("train", "holdout"))
    assert list(train) == list(held) == ["uEst", "yEst"]
    assert len(train) == len(held) == 1024
    assert not train["uEst"].equals(held["uEst"])


def test_a_cut_recording_can_be_read_by_its_rig_file(shared, tmp_path):
    file = tmp_path / "train.csv"
    CASES["pneumatic_cylinder"].parts()["train"].to_csv(file, index=False)
    recording = read_recording(file, read_rig(CASES["pneumatic_cylinder"].rig))
    assert recording["pressure"].values.min() == pytest.approx(
        1e5
    )  # gauge in the file, absolute in the model


def test_an_unknown_name_is_refused_with_the_known_ones(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["real_recordings.py", "out", "emsp"])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 2
    assert "emsp: none of emps" in capsys.readouterr().err


def test_absent_recordings_are_said_to_be(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(real_recordings, "RECORDINGS", tmp_path / "none")
    monkeypatch.setattr(sys, "argv", ["real_recordings.py", str(tmp_path / "out")])
    assert main() == 1
    assert "skipped" in capsys.readouterr().out
    assert not (tmp_path / "out").exists()
