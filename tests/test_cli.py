"""The commands: what they say, how they end, what they leave behind."""

import json
from pathlib import Path

import pandas as pd
import pytest
from click.testing import CliRunner
from malformed import CASES, SOUND_RECORDING, SOUND_RIG, Case, make

from optid import cli
from optid.cli.common import deliver
from optid.effects.library import admitted
from optid.errors import JobError, SolveError
from optid.rigs.rigfile import read_rig, with_effects, write_rig

DATA = Path(__file__).resolve().parents[1] / "data"
BENCH, STEPS, HELD_OUT = DATA / "bench.toml", DATA / "bench.csv", DATA / "bench_holdout.csv"


def run(*arguments):
    return CliRunner().invoke(cli.cli, [str(argument) for argument in arguments], prog_name="optid")


def refused(result, status=2):
    """The one line of a refusal."""
    assert result.exit_code == status, result.output
    line = result.stderr.strip()  # click ends the line that shows ^C
    assert line.startswith("optid: ")
    assert "\n" not in line
    assert "Traceback" not in result.output
    return line


@pytest.fixture
def sound(tmp_path):
    return make(Case("sound", "none", (), SOUND_RIG, SOUND_RECORDING), tmp_path)


@pytest.fixture(autouse=True)
def without_traceback(own_cache, monkeypatch):
    monkeypatch.delenv("OPTID_TRACEBACK", raising=False)


def test_bare_call_is_one_screen():
    result = run()
    assert result.exit_code == 0
    assert all(
        word in result.output for word in ("optid check", "optid simulate", "optid fit", "Exit status")
    )
    assert len(result.output.splitlines()) <= 40
    assert max(map(len, result.output.splitlines())) <= 110


def test_version():
    assert run("--version").output.startswith("optid, version ")


@pytest.mark.parametrize(
    ("arguments", "fragment"),
    [
        (("frob",), "frob"),
        (("--frob",), "--frob"),
        (("fit", BENCH, STEPS), "--out"),
        (("fit", BENCH, "--out", "x"), "RECORDING"),
        (("simulate", BENCH, "--out", "x"), "RECORDING"),
        (("fit", BENCH, STEPS, "--out", "x", "--starts", "0"), "--starts"),
        (("fit", BENCH, STEPS, "--out", "x", "--time-limit", "soon"), "--time-limit"),
        (("fit", BENCH, STEPS, "--out", "x", "--time-limit", "nan"), "--time-limit"),
        (("fit", BENCH, STEPS, "--holdout", STEPS, "--out", "x"), "twice"),
        (("check", BENCH, STEPS, STEPS), "twice"),
    ],
    ids=str,
)
def test_wrong_call_is_refused(arguments, fragment, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert fragment in refused(run(*arguments))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["check", "simulate", "fit"])
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_malformed_input_is_refused(case, command, tmp_path):
    rig, recording = make(case, tmp_path)
    out = tmp_path / "results" / "out"
    message = refused(run(command, rig, recording, *(() if command == "check" else ("--out", out))))
    assert str(rig if case.fault == "rig" else recording) in message
    for fragment in case.fragments:
        assert fragment in message
    assert not out.parent.exists()


def test_malformed_holdout_is_refused(tmp_path, sound):
    rig, recording = sound
    out = tmp_path / "out"
    assert "absent.csv" in refused(
        run("fit", rig, recording, "--holdout", tmp_path / "absent.csv", "--out", out)
    )
    assert not out.exists()


def test_out_that_cannot_be_is_refused(tmp_path, sound):
    rig, recording = sound
    assert "is a file" in refused(run("simulate", rig, recording, "--out", recording))
    assert "--out" in refused(run("simulate", rig, recording, "--out", recording / "inner"))
    beside = rig.with_name("rig.toml")
    beside.write_bytes(rig.read_bytes())
    assert "overwrite" in refused(run("fit", beside, recording, "--out", tmp_path))


def test_check_remarks():
    result = run("check", BENCH, STEPS, HELD_OUT)
    assert result.exit_code == 0
    assert "bench.csv: 8000 samples" in result.output
    assert "bench_holdout.csv: 6000 samples" in result.output


def test_check_of_a_still_recording_fails(tmp_path):
    table = pd.read_csv(STEPS).head(3000).assign(u=0.0, x=0.0)
    table.to_csv(tmp_path / "still.csv", index=False)
    assert run("check", BENCH, tmp_path / "still.csv").exit_code == 1
    out = tmp_path / "out"
    assert "still.csv" in refused(run("fit", BENCH, tmp_path / "still.csv", "--out", out), status=1)
    assert not out.exists()


@pytest.mark.parametrize(
    ("error", "status", "fragment"),
    [
        (SolveError("it diverged"), 1, "it diverged"),
        (ZeroDivisionError("a\nb"), 1, "bug in optid"),
        (KeyboardInterrupt(), 1, "interrupted"),
    ],
    ids=["job", "bug", "interrupt"],
)
def test_failing_job_leaves_nothing(error, status, fragment, tmp_path, monkeypatch):
    import optid.api.simulating

    def fail(*_):
        raise error

    monkeypatch.setattr(optid.api.simulating, "predict", fail)
    assert fragment in refused(run("simulate", BENCH, STEPS, "--out", tmp_path / "out"), status)
    assert list(tmp_path.iterdir()) == []


def test_half_written_results_never_show(tmp_path):
    def write(place):
        (place / "a.json").write_text("{}")
        raise OSError("disk full")

    with pytest.raises(JobError, match="disk full"):
        deliver(tmp_path / "out", write)
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    out = tmp_path_factory.mktemp("simulate") / "deep" / "out"
    return run("simulate", BENCH, STEPS, "--out", out), out


@pytest.mark.parametrize("command", [("check",), ("simulate", "--out", "out")])
def test_a_rig_whose_effects_read_clock_and_past_commands_needs_no_channel_for_them(command, tmp_path):
    rig = read_rig(BENCH)
    effects = tuple(
        e for e in admitted(rig.model) if e.name in ("friction_drift", "sensor_drift", "input_delay")
    )
    assert len(effects) == 3
    path = tmp_path / "rig.toml"
    write_rig(with_effects(rig, effects), path, {})
    options = [tmp_path / word if word == "out" else word for word in command[1:]]
    result = run(command[0], path, STEPS, *options)
    assert result.exit_code == 0, result.output


def test_simulate_writes_what_the_contract_says(simulated):
    result, out = simulated
    assert result.exit_code == 0, result.output
    assert {file.name for file in out.iterdir()} == {
        "prediction.csv",
        "metrics.json",
        "report.html",
        "manifest.json",
        "tables.npz",
    }
    table = pd.read_csv(out / "prediction.csv")
    assert list(table) == ["time", "position", "position_free_run", "position_window"]
    assert len(table) == 8000
    measured = pd.read_csv(STEPS)["x"]
    assert (table["position"] - measured / 1000).abs().max() < 1e-12
    metrics = json.loads((out / "metrics.json").read_text())
    for kind in ("free_run", "window"):
        error = table["position"] - table[f"position_{kind}"]
        known = error.notna()
        y = table["position"][known]
        percent = 100 * (1 - ((error**2).sum() / ((y - y.mean()) ** 2).sum()) ** 0.5)
        assert metrics["position"][kind]["fit_percent"] == pytest.approx(percent, abs=1e-6)
        assert metrics["position"][kind]["rmse"] == pytest.approx((error**2).mean() ** 0.5, rel=1e-6)
        assert metrics["position"][kind]["unit"] == "m"


def test_report_stands_alone(simulated):
    page = (simulated[1] / "report.html").read_text()
    assert "does not know" in page
    assert page.count('<div class="figure"') == 2
    for outside in ("<script src", "<link", 'src="http', "url(http", "@import", "http:", "https:"):
        assert outside not in page


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fit")
    pd.read_csv(STEPS).head(3000).to_csv(folder / "short.csv", index=False)
    held_out = folder / "held_out.csv"
    pd.read_csv(HELD_OUT).head(2000).to_csv(held_out, index=False)
    return run(
        "fit", BENCH, folder / "short.csv", "--holdout", held_out, "--out", folder / "out"
    ), folder / "out"


def test_fit_writes_what_the_contract_says(fitted):
    result, out = fitted
    assert result.exit_code == 0, result.output
    assert {file.name for file in out.iterdir()} == {
        "fit.json",
        "rig.toml",
        "report.html",
        "manifest.json",
        "tables.npz",
    }
    found = json.loads((out / "fit.json").read_text())
    assert found["schema"] == "optid.fit/1"
    assert found["outcome"] == "converged"
    names = {freed.name for freed in read_rig(BENCH).freed}
    assert names <= set(found["parameters"])
    for name in names:
        low, high = found["parameters"][name]["ci95"]
        assert low <= found["parameters"][name]["value"] <= high
    assert found["parameters"]["coulomb_friction"]["unit"] == "N"
    for use in ("train", "holdout"):
        assert set(found[use]["position"]) == {"fit_percent", "rmse", "unit"}
        assert found[use]["position"]["fit_percent"] > 90
    assert isinstance(found["not_identifiable"], list)
    assert isinstance(found["at_bound"], list)


def test_fitted_rig_is_usable_as_input(fitted):
    _, out = fitted
    found = json.loads((out / "fit.json").read_text())["parameters"]
    again = read_rig(out / "rig.toml")
    for name, entry in found.items():
        assert again.parameters[name] == pytest.approx(entry["value"], rel=1e-9)
    assert run("check", out / "rig.toml", STEPS).exit_code == 0


def test_fit_reports_what_it_does_not_know(fitted):
    page = (fitted[1] / "report.html").read_text()
    for heading in ("What this fit does not know", "Convergence", "Parameters", "held out", "optid diagnose"):
        assert heading in page
