"""`optid diagnose` as a user calls it: files in, files out, a rig file that every other command accepts."""

import json
import subprocess
import sys

import numpy as np
import pytest
from click.testing import CliRunner

from optid import cli
from tests.diagnosis.trolley import recording, rig

WIDTH = 0.2


def run(*arguments):
    """In this process, which has everything imported."""
    return CliRunner().invoke(cli.cli, [str(argument) for argument in arguments], prog_name="optid")


def optid(*arguments):
    """As a user calls it."""
    return subprocess.run(
        [sys.executable, "-m", "optid.cli", *map(str, arguments)], capture_output=True, text=True, check=False
    )


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench")
    rig(folder)
    for seed, name in ((1, "one.csv"), (2, "two.csv"), (3, "held.csv")):
        made = recording(seed, name, lambda u: np.sign(u) * np.maximum(np.abs(u) - WIDTH, 0.0))
        columns = [made.time, made["command"].values, made["position"].values]
        np.savetxt(folder / name, np.column_stack(columns), delimiter=",", header="t,u,x", comments="")
    return folder


@pytest.fixture(scope="module")
def answered(bench):
    out = bench / "out"
    done = optid(
        "diagnose",
        bench / "trolley.toml",
        bench / "one.csv",
        bench / "two.csv",
        "--holdout",
        bench / "held.csv",
        "--out",
        out,
    )
    assert done.returncode == 0, done.stderr
    return out, done.stdout


def test_it_writes_its_files_and_says_the_answer(answered):
    out, said = answered
    assert sorted(path.name for path in out.iterdir()) == [
        "diagnosis.json",
        "manifest.json",
        "plant.py",
        "report.html",
        "rig.toml",
        "tables.npz",
    ]
    document = json.loads((out / "diagnosis.json").read_text())
    assert document["schema"] == "optid.diagnosis/1"
    assert document["findings"][0]["effect"] == "dead_zone@drive.command"
    assert document["summary"] in said


def test_the_improved_rig_is_understood_and_predicts_to_the_noise(bench, answered):
    out, _ = answered
    for name, place in (("before", bench / "trolley.toml"), ("after", out / "rig.toml")):
        done = run("simulate", place, bench / "held.csv", "--out", bench / name)
        assert done.exit_code == 0, done.output
    before, after = (
        json.loads((bench / name / "metrics.json").read_text())["position"]["window"]["rmse"]
        for name in ("before", "after")
    )
    assert after < 6.5e-4 < before  # the sensor's noise is 5e-4


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nope.toml", "one.csv", "--holdout", "held.csv", "--out", "new"], "nope.toml"),
        (["trolley.toml", "nope.csv", "--holdout", "held.csv", "--out", "new"], "nope.csv"),
        (["trolley.toml", "one.csv", "--out", "new"], "--holdout"),
        (["trolley.toml", "one.csv", "--holdout", "held.csv"], "--out"),
        (
            ["trolley.toml", "one.csv", "--holdout", "held.csv", "--effects", "nope.py", "--out", "new"],
            "nope.py",
        ),
        (["trolley.toml", "one.csv", "--holdout", "held.csv", "--out", "."], "rig.toml"),
    ],
)
def test_a_wrong_call_is_one_line_and_leaves_nothing(bench, arguments, said, monkeypatch):
    monkeypatch.chdir(bench)
    if arguments[-1] == ".":
        (bench / "rig.toml").write_text((bench / "trolley.toml").read_text())
        arguments = ["rig.toml", *arguments[1:]]
    done = run("diagnose", *arguments)
    assert done.exit_code == 2
    assert len(done.stderr.strip().splitlines()) == 1
    assert said in done.stderr
    assert not (bench / "new").exists()


@pytest.mark.full
def test_a_recording_to_validate_on_is_read_and_told(bench, tmp_path):
    """It counts among those fitted to; one that is held out as well is refused."""
    call = ("diagnose", bench / "trolley.toml", bench / "one.csv", "--holdout", bench / "held.csv")
    done = optid(*call, "--validate", bench / "two.csv", "--time-limit", 0.1, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    about = json.loads((tmp_path / "out" / "diagnosis.json").read_text())["about"]
    assert [path.rsplit("/")[-1] for path in about["training"]] == ["one.csv", "two.csv"]
    twice = optid(*call, "--validate", bench / "held.csv", "--out", tmp_path / "twice")
    assert twice.returncode == 2
    assert "held.csv" in twice.stderr
