"""The wheel alone in an empty folder: what a user has after `pip install optid`, and every command on its examples."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The unpacked wheel, without a line of the checkout beside it."""
    pytest.importorskip("hatchling")
    folder = tmp_path_factory.mktemp("wheel")
    call = [
        sys.executable,
        "-c",
        "import sys, hatchling.build as b; print(b.build_wheel(sys.argv[1]))",
        str(folder),
    ]
    made = subprocess.run(call, cwd=ROOT, capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stderr
    wheel = next(folder.glob("*.whl"))
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        archive.extractall(folder / "site")
    return folder / "site", names, wheel


def optid(installed, folder, *arguments):
    site = installed[0]
    environment = {**os.environ, "PYTHONPATH": str(site), "XDG_CACHE_HOME": str(Path.home() / ".cache")}
    code = "import optid, sys; from optid.cli import main; assert optid.__file__.startswith(sys.argv.pop(1)); main()"
    return subprocess.run(
        [sys.executable, "-c", code, str(site), *map(str, arguments)],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_wheel_holds_what_it_needs_and_no_more(installed):
    _, names, wheel = installed
    wanted = [
        "py.typed",
        "data/bench.toml",
        "data/worn.csv",
        "data/worn_holdout.csv",
        "report/shell.html.j2",
        "report/figures.js",
        "report/plotly/plotly-basic.min.js",
        "report/plotly/LICENSE",
        "results/schemas/fit-1.schema.json",
    ]
    assert {f"optid/{name}" for name in wanted} <= names
    assert not [name for name in names if name.startswith(("tests/", "studies/", "data/"))]
    assert wheel.stat().st_size < 3e6


@pytest.fixture(scope="module")
def example(installed, tmp_path_factory):
    folder = tmp_path_factory.mktemp("empty")
    done = optid(installed, folder, "example", "start")
    assert done.returncode == 0, done.stderr
    return folder


def test_the_example_is_written_and_checked(installed, example):
    assert (example / "start" / "worn.csv").is_file()
    again = optid(installed, example, "example", "start")
    assert again.returncode == 2 and "there already" in again.stderr
    done = optid(installed, example, "simulate", "start/bench.toml", "start/bench.csv", "--out", "sim")
    assert done.returncode == 0, done.stderr
    assert (example / "sim" / "report.html").is_file()


@pytest.mark.full
def test_every_command_runs_on_the_example(installed, example):
    rig, holdout = "start/bench.toml", "start/worn_holdout.csv"
    calls = [
        ("check", rig, "start/worn.csv"),
        ("fit", rig, "start/bench.csv", "--holdout", "start/bench_holdout.csv", "--out", "fit"),
        ("simulate", rig, "start/bench_holdout.csv", "--fit", "fit", "--out", "band"),
        ("diagnose", rig, "start/worn.csv", "--holdout", holdout, "--out", "diagnosis"),
        ("plan", rig, "--rivals", "valve_lag,input_delay", "--seconds", "4", "--out", "plan"),
        ("identify", "start/bench.csv", "--rig", rig, "--orders", "2,4", "--out", "armax"),
        ("tune", "armax/armax.json", "--out", "tune"),
        ("live", rig, "--driver", "simulated", "--seconds", "2", "--fast", "--out", "live"),
    ]
    for call in calls:
        done = optid(installed, example, *call)
        assert done.returncode == 0, (call, done.stderr)
        out = example / call[call.index("--out") + 1] if "--out" in call else None
        assert out is None or (out / "report.html").stat().st_size < 1.5e6
