"""Results are never lost at the end, and say where they come from; what cannot be is refused before the work starts."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner
from malformed import RIG, SOUND_RECORDING, SOUND_RIG, Case, make

from optid import cli
from optid.cli import results
from optid.cli.results import deliver
from optid.core.resultset import MANIFEST, staging
from optid.errors import JobError, RigError

DATA = Path(__file__).resolve().parents[1] / "data"
AXIS = """
from optid.core.parameter import Parameter
GAIN = Parameter("gain", "m/(s V)", 0.1, "a gain", "none", bounds=(0.0, 10.0))
def axis(s):
    x = s.state("x", "m", 0.1)
    s.rate(x, s.param(GAIN) * s.input("u", "V"))
    s.output("position", "m", s.site("sensor.position", x))
"""
AXIS_RIG = """
model = "{axis}:axis"
[parameters]
gain = "0.1 m/(s V)"
[channels]
time = {{ column = "t", unit = "s" }}
u = {{ column = "u", unit = "V" }}
position = {{ column = "x", unit = "mm" }}
"""


def run(*arguments):
    return CliRunner().invoke(cli.cli, [str(argument) for argument in arguments], prog_name="optid")


@pytest.fixture
def sound(tmp_path):
    (tmp_path / "in").mkdir()
    return make(Case("sound", "none", (), SOUND_RIG, SOUND_RECORDING), tmp_path / "in")


@pytest.fixture
def quick(monkeypatch):
    """A simulation that takes no time."""
    import pandas as pd

    import optid.api.simulating
    from optid.api.inputs import given, rig_of
    from optid.results.simulation import SimulationResult

    score = {"fit_percent": 99.0, "rmse": 1e-5, "unit": "m"}
    document = {
        "schema": SimulationResult.SCHEMA,
        "position": {"window": score, "free_run": score},
        "about": {"horizon": 0.5, "starts": [], "notes": []},
    }
    table = pd.DataFrame({"recording": ["run"], "time": [0.0]})
    result = SimulationResult(document, {"prediction": table}, {"report.html": "<html>"})

    def read_only(rig, recording, **_):
        given(rig_of(rig), recording)
        return result

    monkeypatch.setattr(optid.api.simulating, "simulate", read_only)


def one(place):
    (place / "a.json").write_text('{"a": 1}')


def test_every_document_says_where_it_comes_from(sound, tmp_path, quick):
    rig, recording = sound
    result = run("simulate", rig, recording, "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    for name in ("metrics.json", MANIFEST):
        content = json.loads((tmp_path / "out" / name).read_text())
        assert content["schema"].startswith("optid.")
        assert content["version"]
        assert content["command"].startswith(f"optid simulate {rig}")
        assert set(content["inputs"]) == {str(rig), str(recording)}
        assert all(len(digest) == 64 for digest in content["inputs"].values())


def test_the_users_own_plant_goes_with_the_results(tmp_path, sound, quick):
    from optid.rigs.rigfile import read_rig, write_rig

    (tmp_path / "axis.py").write_text(AXIS)
    (tmp_path / "axis.toml").write_text(AXIS_RIG.format(axis="axis.py"))
    rig = read_rig(tmp_path / "axis.toml")
    deliver(tmp_path / "out", lambda place: write_rig(rig, place / "rig.toml"))
    assert (tmp_path / "out" / "axis.py").read_text() == AXIS
    assert "axis.py" in json.loads((tmp_path / "out" / MANIFEST).read_text())["files"]
    (tmp_path / "axis.py").unlink()
    assert read_rig(tmp_path / "out" / "rig.toml").model_name == "axis.py:axis"


def test_a_plant_outside_the_rigs_folder_needs_a_flag(tmp_path, sound, quick):
    (tmp_path / "axis.py").write_text(AXIS)
    rig = tmp_path / "in" / "axis.toml"
    for path in ("../axis.py", tmp_path / "axis.py"):
        rig.write_text(AXIS_RIG.format(axis=path))
        refused = run("simulate", rig, sound[1], "--out", tmp_path / "out")
        assert refused.exit_code == 2
        assert "outside the folder" in refused.stderr and "--outside-files" in refused.stderr
        assert not (tmp_path / "out").exists()
        allowed = run("simulate", rig, sound[1], "--out", tmp_path / "out", "--outside-files")
        assert allowed.exit_code == 0, allowed.output
        inputs = json.loads((tmp_path / "out" / MANIFEST).read_text())["inputs"]
        assert str(tmp_path / "axis.py") in inputs
        for file in (tmp_path / "out").iterdir():
            file.unlink()
        (tmp_path / "out").rmdir()
    assert "OPTID_OUTSIDE_FILES" not in os.environ


def test_where_the_folder_refuses_the_old_set_stays_and_the_new_one_goes_elsewhere(tmp_path, monkeypatch):
    out = tmp_path / "out"
    deliver(out, one)
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    real = staging

    def full(folder):
        if folder == out:
            raise OSError(28, "No space left on device")
        return real(folder)

    monkeypatch.setattr(results.resultset, "staging", full)
    with pytest.raises(JobError, match=f"No space left on device; all of them are in {tmp_path}/out-rescued"):
        deliver(out, one)
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
    assert {path.name for path in (tmp_path / "out-rescued").iterdir()} == {"a.json", MANIFEST}


@pytest.mark.parametrize("error", [RigError("no twin"), KeyError("a bug")])
def test_one_file_that_cannot_be_made_does_not_lose_the_others(tmp_path, error):
    def write(place):
        one(place)
        raise error

    with pytest.raises(JobError, match="the files that could be written are in"):
        deliver(tmp_path / "out", write)
    assert not (tmp_path / "out").exists()
    assert (tmp_path / "out-rescued" / "a.json").exists()


def test_a_folder_in_the_way_is_refused_before_work_starts(sound, tmp_path):
    (tmp_path / "out" / "report.html").mkdir(parents=True)
    refused = run("simulate", *sound, "--out", tmp_path / "out")
    assert refused.exit_code == 2
    assert "a folder named report.html" in refused.stderr


def test_a_name_too_long_is_refused_before_work_starts(sound, tmp_path, quick):
    assert run("simulate", *sound, "--out", tmp_path / ("x" * 300)).exit_code == 2
    deep = tmp_path
    while len(str(deep)) < 4040:  # the folder itself has room, files staged in it have not
        deep = deep / ("d" * min(100, 4070 - len(str(deep))))
    refused = run("simulate", *sound, "--out", deep)
    assert refused.exit_code == 2
    assert "nothing can be written" in refused.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["in"]


def test_two_runs_do_not_share_a_folder(sound, tmp_path, quick):
    fcntl = pytest.importorskip("fcntl")
    (tmp_path / "out").mkdir()
    descriptor = os.open(tmp_path / "out", os.O_RDONLY)
    fcntl.flock(descriptor, fcntl.LOCK_EX)
    refused = run("simulate", *sound, "--out", tmp_path / "out")
    assert refused.exit_code == 2
    assert "another run" in refused.stderr
    os.close(descriptor)
    assert run("simulate", *sound, "--out", tmp_path / "out").exit_code == 0


def test_what_a_killed_run_left_goes_with_the_next(sound, tmp_path, quick):
    (tmp_path / "out" / ".optid-new-abc" / "old").mkdir(parents=True)
    (tmp_path / "out" / ".optid-new-abc" / "half.json").write_text("{")
    assert run("simulate", *sound, "--out", tmp_path / "out").exit_code == 0
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"metrics.json", "prediction.csv", "report.html", "tables.npz", MANIFEST}


SLEEPER = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background ignores it
import optid.estimation.prediction
optid.estimation.prediction.predict = lambda *_: (print("at work", flush=True), time.sleep(60))
from optid.cli import main
main()
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.full)])
def test_a_signal_is_told_and_leaves_nothing(sound, tmp_path, number):
    process = subprocess.Popen(
        [sys.executable, "-c", SLEEPER, "simulate", *map(str, sound), "--out", tmp_path / "out"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == "at work\n"
    process.send_signal(number)
    _, said = process.communicate(timeout=30)
    assert process.returncode == 1
    assert said.strip() == f"optid: interrupted by {number.name}; nothing was written"
    assert not (tmp_path / "out").exists()


def test_a_shut_terminal_ends_a_run_like_the_other_signals(request):
    from optid.cli.run import begun

    inherited = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # `nohup` ignores it, and so does its child
    request.addfinalizer(lambda: signal.signal(signal.SIGHUP, inherited))
    before = {number: signal.getsignal(number) for number in (signal.SIGHUP, signal.SIGTERM, signal.SIGINT)}
    with begun(["check"]):
        assert (
            len({signal.getsignal(number) for number in before if before[number] is not signal.SIG_IGN}) == 1
        )
        assert signal.getsignal(signal.SIGHUP) is not before[signal.SIGHUP]
    assert {number: signal.getsignal(number) for number in before} == before


def test_a_signal_while_results_are_written_waits(sound, tmp_path, quick, monkeypatch):
    real = results.resultset.commit

    def interrupted(*arguments):
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.01)
        real(*arguments)

    monkeypatch.setattr(results.resultset, "commit", interrupted)
    result = run("simulate", *sound, "--out", tmp_path / "out")
    assert result.exit_code == 1
    assert f"interrupted by SIGTERM; the results are in {tmp_path / 'out'}" in result.stderr
    assert (tmp_path / "out" / MANIFEST).exists()


def test_what_libraries_warn_of_is_not_shown_unless_asked_for(monkeypatch):
    import warnings

    monkeypatch.setattr(cli, "cli", lambda: warnings.warn("overflow in square", RuntimeWarning, stacklevel=1))
    for options, count in (([], 0), (["always"], 1)):
        monkeypatch.setattr(sys, "warnoptions", options)
        with warnings.catch_warnings(record=True) as seen:
            warnings.simplefilter("always")
            cli.main()
        assert len(seen) == count


def test_progress_as_json_is_lines_on_stderr(sound, tmp_path, quick):
    result = run("simulate", *sound, "--out", tmp_path / "out", "--progress", "json")
    lines = [json.loads(line) for line in result.stderr.splitlines()]
    assert {"stage": "simulating", "share": 1.0, "words": "done"} in lines
    assert all(set(line) == {"stage", "share", "words"} for line in lines)
    for how in ("none", "auto"):
        assert run("simulate", *sound, "--out", tmp_path / "out", "--progress", how).stderr == ""


def test_an_event_is_a_line_for_programs_alone(capsys):
    from optid.cli import progress

    progress.event("live", 0.5, "the loop runs")
    assert capsys.readouterr().err == ""
    progress.choose("json")
    try:
        progress.event("live", None, "the loop runs")
    finally:
        progress.choose("auto")
    assert json.loads(capsys.readouterr().err) == {"stage": "live", "share": None, "words": "the loop runs"}


@pytest.mark.parametrize("how", ["option", "environment"])
def test_threads_bound_the_cores_everywhere(sound, tmp_path, how, monkeypatch):
    import optid.api.simulating
    from optid.core import threads

    seen = []

    def look(*_):
        seen.extend(
            [threads.WORKERS, *(os.environ[name] for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS"))]
        )
        raise JobError("seen")

    monkeypatch.setattr(optid.api.simulating, "predict", look)
    options = ["--threads", "1"] if how == "option" else []
    if how == "environment":
        monkeypatch.setenv("OPTID_THREADS", "1")
    before = threads.WORKERS
    assert "seen" in run("simulate", *sound, "--out", tmp_path / "out", *options).stderr
    assert seen == [1, "1", "1"]
    monkeypatch.delenv("OPTID_THREADS", raising=False)
    threads.limit(None)
    assert before == threads.WORKERS


def test_rigs_that_contradict_themselves_are_refused(sound, tmp_path):
    rig, recording = sound
    for old, new, words in (
        ('rod_diameter = "16 mm"', 'rod_diameter = "43 mm"', "the rod is thinner than the bore"),
        ('exhaust_pressure = "1 bar"', 'exhaust_pressure = "8 bar"', "supply pressure is above the exhaust"),
    ):
        rig.write_text(RIG.replace(old, new))
        refused = run("fit", rig, recording, "--out", tmp_path / "out")
        assert refused.exit_code == 2
        assert words in refused.stderr
        assert f"{rig}: parameters." in refused.stderr
