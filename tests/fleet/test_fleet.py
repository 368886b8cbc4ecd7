"""A fleet from its file to its report: nights, what is told, and the command line."""

import json

import pytest
from click.testing import CliRunner

import optid
from optid.cli import cli
from optid.errors import InputError
from optid.fleet.fleetfile import Nightly, read_fleet
from optid.fleet.nights import by_rig, diagnoses, fits, night_tests
from optid.fleet.row import read_run

# Stands for optid: a fit leaves a rig file, a test a quantity that grows on one rig from the seventh night on.
OPTID = """
import hashlib, json, random
from pathlib import Path
out = Path(words[words.index("--out") + 1])
def leave(name, text):
    (out / name).write_text(text)
    digest = hashlib.sha256(text.encode()).hexdigest()
    tables = {"replaced": {}, "earlier": {}, "removed": []}
    (out / "manifest.json").write_text(json.dumps({"schema": "optid.manifest/1", "files": {name: digest}, **tables}))
if words[0] == "fit":
    (out / "rig.toml").write_text("name = 'fitted'\\n")
    leave("fit.json", json.dumps({"outcome": "converged", "parameters": {}}))
elif words[:2] == ["fleet", "test"]:
    night = Path(words[3])
    day, rig = int(night.stem[-2:]), night.parent.name
    noise = random.Random(f"{rig} {night.stem}")
    one = {"value": noise.gauss(0.0, 1e-3) + (0.02 * max(0, day - 6) if rig == "r2" else 0.0), "sd": 1e-3, "unit": "1"}
    other = {"value": noise.gauss(75.0, 0.1), "sd": 0.1, "unit": "N"}
    leave("test.json", json.dumps({"quantities": {"valve_deadband.width": one, "coulomb_friction": other}}))
else:
    finding = {"effect": "valve_deadband", "parameters": {"width": {"value": 0.1, "unit": "1", "ci95": [0.09, 0.11]}}}
    leave("diagnosis.json", json.dumps({"verdict": "missing-physics", "findings": [finding], "test": {"p_value": 1e-9},
        "improved": {"parameters": {}}}))
"""


@pytest.fixture
def plant(tmp_path):
    """Four rigs over nine nights."""
    for rig in range(4):
        (tmp_path / "rigs").mkdir(exist_ok=True)
        (tmp_path / "rigs" / f"r{rig}.toml").write_text(f'name = "r{rig}"\n')
        for day in range(1, 10):
            file = tmp_path / "data" / f"r{rig}" / f"2026-10-{day:02}.csv"
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(f"{rig},{day}\n")
    (tmp_path / "fleet.toml").write_text(
        '[glob]\nrecordings = "data/{rig}/{date}.csv"\nrig = "rigs/{rig}.toml"\n[nightly]\nreference = 6\n'
    )
    return tmp_path


def test_nights_are_fitted_tested_told_and_diagnosed(scripted, plant):
    scripted(OPTID)
    out = plant / "out"
    result = optid.fleet.run(plant / "fleet.toml", out, workers=2)
    assert [(one["rig"], one["quantity"], one["way"]) for one in result.told] == [
        ("r2", "valve_deadband.width", "grows")
    ]
    assert result.told[0]["date"] in ("2026-10-08", "2026-10-09")
    assert "valve deadband.width grows on 1 of 4 rigs, first seen on " in result.summary()
    assert result.document["outcomes"] == {"done": 4 + 36 + 1}
    rows = result.to_frame()
    (diagnosis,) = rows[rows["job"] == "diagnose"].to_dict("records")
    assert diagnosis["verdict"] == "missing-physics"
    assert json.loads(diagnosis["effects"])["valve_deadband"]["width"]["ci95"] == [0.09, 0.11]
    assert (rows["rig_sha256"].str.len() == 64).all()
    late = rows[(rows["rig"] == "r2") & (rows["date"] == "2026-10-09") & (rows["job"] == "test")].iloc[0]
    assert late["p"] < 1e-4
    assert late["valve_deadband.width low"] < late["valve_deadband.width"] < late["valve_deadband.width high"]
    result.save(out)
    again = optid.load(out)
    assert again.document == result.document
    assert again.to_frame().equals(result.to_frame())
    page = (out / "report.html").read_text()
    assert "plotly-basic.min.js" in page
    assert len(page) < 400_000
    assert "r2.diagnosis-" in page


def test_the_next_night_does_what_is_new(scripted, plant):
    scripted(OPTID)
    out, data = plant / "out", plant / "data"
    file = plant / "fleet.toml"
    file.write_text(
        file.read_text().replace("data/{rig}/", "new/{rig}/").replace("reference = 6", "reference = 3")
    )
    for rig in ("r0", "r1"):
        (plant / "new" / rig).mkdir(parents=True)
        for day in ("01", "02", "03"):
            (data / rig / f"2026-10-{day}.csv").rename(plant / "new" / rig / f"2026-10-{day}.csv")
    optid.fleet.run(file, out, workers=2)
    before = {place: place.stat().st_mtime_ns for place in out.glob("*/run.json")}
    assert len(before) == 2 + 6
    (data / "r1" / "2026-10-04.csv").rename(plant / "new" / "r1" / "2026-10-04.csv")
    optid.fleet.run(file, out, workers=2)
    assert {place: place.stat().st_mtime_ns for place in before} == before
    assert {place.parent.name for place in out.glob("*/run.json")} == {
        *(place.parent.name for place in before),
        "r1-2026-10-04",
    }


def test_a_diagnosis_holds_the_newest_night_out(plant):
    rigs = by_rig(read_fleet(plant / "fleet.toml").jobs)
    (plant / "out" / "r2.fit").mkdir(parents=True)
    (plant / "out" / "r2.fit" / "rig.toml").touch()
    (job,) = diagnoses(rigs, [{"rig": "r2", "date": "2026-10-09"}], plant / "out")
    assert [path[-6:-4] for path in job.train] == ["06", "07", "08"]
    assert [path[-6:-4] for path in job.holdout] == ["09"]
    assert [len(job.train) for job in fits(rigs, Nightly(reference=5))] == [5] * 4
    assert fits(rigs, Nightly(reference=12)) == []
    assert len(night_tests(rigs, Nightly(), plant / "out")) == 9  # the others have no fitted model


def test_the_command_line_tells_and_fails_where_a_row_did(scripted, plant):
    scripted("print('no such file'); sys.exit(2)")
    (plant / "fleet.toml").write_text('[[rows]]\nrig = "rigs/r1.toml"\ntrain = ["a.csv"]\n')
    out = plant / "out"
    ran = CliRunner().invoke(cli, ["fleet", str(plant / "fleet.toml"), "--out", str(out), "--threads", "1"])
    assert ran.exit_code == 1
    assert "r1: bad-input: no such file" in ran.output
    assert {"fleet.json", "fleet.parquet", "report.html", "manifest.json"} <= {
        one.name for one in out.iterdir()
    }
    assert read_run(out / "r1")["status"] == 2
    told = CliRunner().invoke(cli, ["fleet", "status", str(out), "--out", str(plant / "status")])
    assert told.exit_code == 0
    assert "1 of 1 rows finished (1 bad-input), 0 running, 0 waiting" in told.output
    assert json.loads((plant / "status" / "status.json").read_text())["outcomes"] == {"bad-input": 1}
    (out / "report.html").unlink()
    assert CliRunner().invoke(cli, ["fleet", "report", str(out)]).exit_code == 0
    assert (out / "report.html").is_file()


def test_a_folder_without_a_fleet_is_said(tmp_path):
    with pytest.raises(InputError, match="a folder that optid fleet wrote into"):
        optid.fleet.status(tmp_path)
