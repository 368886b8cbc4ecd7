"""`optid tune` from the outside: its files to the letter of the contract, and what it says when something is wrong."""

import gzip
import json
import math
import re
from base64 import b64decode
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from optid.armax.files import ArmaxFile, SavedModel, load, save
from optid.armax.model import Armax
from optid.cli import cli
from optid.core.translate import literal
from optid.errors import InputError
from optid.pid.controller import Controller, Gains, Notch, Settings
from optid.rigs.rigfile import read_rig
from optid.tuning.compensation import dead_band_of, friction_of
from optid.tuning.files import load as load_pid
from optid.tuning.files import units
from optid.tuning.margins import margins
from optid.tuning.plant import behind, plant_of
from tests.tuning.small_axis import T, axis

DATA = Path(__file__).parents[2] / "data"
QUICK = ["--starts", "1", "--horizon", "0.8"]
SOON = ["--time-limit", "5"]  # where any gains will do


@pytest.fixture
def model_file(tmp_path):
    return written(tmp_path / "armax.json", axis(spread=0.05))


def written(path, model, output="position"):
    save(path, ArmaxFile("command", output, len(model.a) - 1, (SavedModel(model),)))
    return path


def run(*arguments):
    return CliRunner().invoke(cli, ["tune", *map(str, arguments)], catch_exceptions=False)


def strict(path):
    def refuse(text):
        raise ValueError(f"{text} is no JSON")

    return json.loads(Path(path).read_text(), parse_constant=refuse)


def test_a_plain_model_is_enough(model_file, tmp_path):
    result = run(model_file, "--out", tmp_path / "out", "--export")
    assert result.exit_code == 0, result.output
    assert "6 cm" in result.output and "±5 V" in result.output
    content = strict(tmp_path / "out" / "pid.json")
    assert content["schema"] == "optid.pid/1"
    assert content["sample_time"] == T
    assert (
        content["limits"]["low"] == -5.0
        and content["limits"]["high"] == 5.0
        and content["limits"]["rate"] is None
    )
    assert (
        content["units"]["kp"] == "V/m"
        and content["units"]["ki"] == "V/(m s)"
        and content["units"]["kd"] == "V s/m"
    )
    assert set(content["gains"]) >= {"kp", "ki", "kd", "derivative_filter", "setpoint_weight"}
    assert content["margins"]["maximum_sensitivity"] <= 5.0
    assert content["cost"]["plant"] == "the identified model with dry friction"
    assert "clamp" in content["anti_windup"]["kind"] and "kp (b r - y)" in content["control_law"]["equation"]
    own, limit = content["cost"]["itae"], content["hunting_limit"]
    resting = [one for one in content["baselines"].values() if one["stable"] and one["hunting"] <= limit]
    assert all(one["itae"] >= own for one in resting if one["maximum_sensitivity"] <= 5.0)
    assert {row["size"] for row in content["by_size"]} >= {0.06, -0.06, 0.015, -0.015}
    assert all(row["hunting"] <= limit for row in content["by_size"])
    assert content["baselines"]["paper_per_cm"]["stable"] is False
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.count('<div class="figure"') >= 3 and "http" not in page
    assert {file.name for file in (tmp_path / "out").iterdir()} == {
        "pid.json",
        "report.html",
        "manifest.json",
        "pid.h",
        "pid.st",
    }


def test_the_file_gives_the_controller_whose_cost_it_states(tmp_path):
    """Simulated here from pid.json and armax.json alone, ITAE of the steps without noise is what the file says."""
    path = written(tmp_path / "m.json", Armax((1.0, -1.9, 0.9025), ((0.0, 1e-3),), nk=(1,), sample_time=T))
    result = run(path, "--out", tmp_path, "--rate", "400 V/s", "--resolution", "0.01", *QUICK, *SOON)
    assert result.exit_code == 0, result.output
    content, model = strict(tmp_path / "pid.json"), load(path).chosen
    controller = load_pid(tmp_path / "pid.json")
    assert content["cost"]["plant"] == "the identified linear model"
    total = sum(one["weight"] * one["itae"] for one in content["responses"])
    assert content["cost"]["itae"] == pytest.approx(total, rel=1e-12)
    for said in [one for one in content["responses"] if not one["noisy"]][:3]:
        controller.reset(0.0, 0.0)
        y, u, itae = [0.0], [], 0.0
        for n in range(400):
            itae += T * (n * T) * abs(said["size"] - y[n])
            u.append(controller.step(said["size"], y[n]))
            past = [y[n - i] if n >= i else 0.0 for i in range(len(model.a) - 1)]
            y.append(
                -np.dot(model.a[1:], past) + sum(b * u[n - i] for i, b in enumerate(model.b[0]) if n >= i)
            )
        assert said["itae"] == pytest.approx(itae, rel=1e-6)
        assert np.max(np.abs(np.diff(u))) <= 0.8 + 1e-9


def test_wishes_are_kept(model_file, tmp_path):
    result = run(
        model_file,
        "--out",
        tmp_path,
        "--limits",
        "-2",
        "3",
        "--ms",
        "1.5",
        "--setpoint",
        "40 mm",
        "--setpoint",
        "-0.02",
        "--disturbance",
        "0.3 V",
        "--scenarios",
        "3",
        "--robust",
        "mean",
        "--cost",
        "iae",
        *QUICK,
    )
    assert result.exit_code == 0, result.output
    content = strict(tmp_path / "pid.json")
    assert (content["limits"]["low"], content["limits"]["high"]) == (-2.0, 3.0)
    assert content["margins"]["maximum_sensitivity"] <= 1.5
    names = [one["name"] for one in content["responses"]]
    assert names[:2] == ["step to 0.04", "step to -0.02"] and names[-1] == "load 0.3"
    for one in content["responses"]:
        assert one["command_low"] >= -2.0 and one["command_high"] <= 3.0


def test_profile_and_rig(model_file, tmp_path):
    path = tmp_path / "way.csv"
    path.write_text("time;wanted\n0;0\n0.1;0.02\n0.3;0.03\n0.5;0\n")
    rig = tmp_path / "slow.toml"
    rig.write_text((DATA / "bench.toml").read_text())
    result = run(
        model_file,
        "--out",
        tmp_path / "o",
        "--profile",
        path,
        "--rig",
        rig,
        "--check-only",
        "--starts",
        "1",
        "--ms",
        "none",
    )
    assert result.exit_code == 0, result.output
    content = strict(tmp_path / "o" / "pid.json")
    assert content["responses"][0]["name"] == "way"
    assert content["physical_model"]["itae"] > 0
    assert "full scale" in result.output


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--limits", "5,-5"], "low < high"),
        (["--limits", "1,5"], "contains 0"),
        (["--limits", "a,b"], "--limits"),
        (["--ms", "0.9"], "maximum_sensitivity"),
        (["--setpoint", "0"], "setpoint"),
        (["--setpoint", "6 kg"], "kg"),
        (["--sample-time", "0.001"], "sample_time"),
        (["--free", "kp,kq"], "kq"),
        (["--order", "9"], "order"),
        (["--resolution", "50"], "resolution"),
        (["--horizon", "1e-3"], "horizon"),
        (["--rate", "-3"], "rate"),
        (["--profile", "nowhere.csv"], "no such file"),
        (["--rig", "nowhere.toml"], "nowhere.toml"),
        (["--disturbance", "0"], "disturbance"),
        (["--effort", "-1"], "effort"),
        (["--gain-margin", "0.5"], "gain_margin"),
    ],
)
def test_wrong_calls_are_said(model_file, tmp_path, arguments, said):
    result = run(model_file, "--out", tmp_path / "out", *arguments)
    assert result.exit_code == 2
    assert said in result.output and len(result.output.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("model", "status", "said"),
    [
        (Armax((1.0, -0.9), ((0.0,),), nk=(1,), sample_time=T), 2, "zero static gain"),
        (Armax((1.0, -0.9), ((0.1,), (0.2,)), nk=(1, 1), sample_time=T), 2, "2 inputs"),
        (Armax((1.0, -3.0), ((1e-3,),), nk=(40,), sample_time=T), 1, "stabilise"),
    ],
)
def test_models_that_cannot_be_tuned(tmp_path, model, status, said):
    result = run(written(tmp_path / "bad.json", model), "--out", tmp_path / "out", *QUICK)
    assert result.exit_code == status
    assert said in result.output
    assert not (tmp_path / "out").exists()


@pytest.mark.full
def test_difficult_models_are_tuned_with_a_warning(tmp_path):
    unstable = Armax((1.0, -1.05), ((0.1,),), nk=(1,), sample_time=T)
    result = run(
        written(tmp_path / "m.json", unstable, "level"), "--out", tmp_path / "out", "--limits", "5", *QUICK
    )
    assert result.exit_code == 0, result.output
    assert "unstable" in result.output
    assert any("unstable" in remark for remark in strict(tmp_path / "out" / "pid.json")["remarks"])


@pytest.mark.full
def test_a_sensitivity_nobody_asked_for_stops_nothing(tmp_path):
    """A fast unstable pole behind a delay: no loop can be as calm as the default wants."""
    path = written(tmp_path / "m.json", Armax((1.0, -1.25), ((0.1,),), nk=(3,), sample_time=T), "level")
    result = run(path, "--out", tmp_path / "out", "--limits", "5", "--setpoint", "0.1", *QUICK)
    assert result.exit_code == 0, result.output
    assert "the bound is dropped" in result.output
    assert strict(tmp_path / "out" / "pid.json")["margins"]["maximum_sensitivity"] > 2.0
    asked = run(path, "--out", tmp_path / "no", "--limits", "5", "--setpoint", "0.1", "--ms", "2", *QUICK)
    assert asked.exit_code == 1 and "no gains keep" in asked.output


@pytest.mark.full
def test_a_model_in_other_units_gets_a_step_of_its_own(tmp_path):
    """Static gain 200: half of the command's range asks for a step of hundreds."""
    model = Armax((1.0, -0.98), ((4.0,),), nk=(1,), sample_time=0.1)
    result = run(
        written(tmp_path / "m.json", model, "pressure_a"), "--out", tmp_path / "out", "--starts", "1"
    )
    assert result.exit_code == 0, result.output
    assert "500 Pa" in result.output


def test_not_a_model_file(tmp_path):
    for text in ("", "[]", '{"schema": "optid.fit/1"}', '{"schema": "optid.armax/1"}'):
        path = tmp_path / "m.json"
        path.write_text(text)
        assert run(path, "--out", tmp_path / "out").exit_code == 2


@pytest.mark.parametrize(
    "change",
    [
        {"schema": "optid.pid/2"},
        {"gains": {"kp": "x"}},
        {"gains": {"kq": 1.0}},
        {"gains": None},
        {"limits": {}},
        {"sample_time": 0.0},
        {"anti_windup": {"kind": "prayer", "tracking_time": 0.0}},
    ],
)
def test_a_wrong_pid_file_is_refused(model_file, tmp_path, change):
    controller = Controller(Gains(1.0), Settings(T))
    content = {
        "schema": "optid.pid/1",
        "gains": dict(vars(controller.gains)),
        "sample_time": T,
        "limits": {"low": None, "high": 5.0, "rate": None},
    }
    path = tmp_path / "pid.json"
    path.write_text(json.dumps(content))
    assert load_pid(path).settings.low == -math.inf
    path.write_text(json.dumps(content | change))
    with pytest.raises(InputError):
        load_pid(path)


def test_units_of_gains():
    assert (
        units("V", "m")["kp"] == "V/m" and units("1", "m")["kp"] == "1/m" and units("V", "1")["ki"] == "V/s"
    )
    assert units("V", "V")["kp"] == "1" and units("V", "V")["kd"] == "s"


def test_a_set_point_out_of_reach_is_refused_by_name(tmp_path):
    """Gain 2 mm/V and 5 V: nothing holds more than 10 mm, and no horizon helps."""
    path = written(tmp_path / "m.json", Armax((1.0, -0.95), ((1e-4,),), nk=(1,), sample_time=0.01))
    result = run(path, "--out", tmp_path / "out", "--setpoint", "50 mm", "--limits", "-5,5")
    assert result.exit_code == 2 and "out of reach" in result.output and "0.01 m" in result.output
    assert not (tmp_path / "out").exists()


def test_a_reverse_acting_plant_gets_negative_gains_and_all_figures(tmp_path):
    path = written(tmp_path / "m.json", Armax((1.0, -0.95), ((-1e-4,),), nk=(1,), sample_time=0.01))
    result = run(
        path,
        "--out",
        tmp_path / "out",
        "--setpoint",
        "5 mm",
        "--limits",
        "-5,5",
        "--present",
        "-500,-2000,0",
        "--horizon",
        "2",
        "--starts",
        "1",
        *SOON,
    )
    assert result.exit_code == 0, result.output
    content = strict(tmp_path / "out" / "pid.json")
    assert content["gains"]["kp"] < 0.0 and content["baselines"]["present"]["gains"]["kp"] == -500.0
    assert content["baselines"]["present"]["itae"] >= content["cost"]["itae"]
    page = (tmp_path / "out" / "report.html").read_text()
    packed = re.findall(r'class="figure"[^>]*><script type="application/gzip">(.*?)</script>', page)
    assert any(
        "−kp" in json.loads(gzip.decompress(b64decode(one)))["layout"]["xaxis"]["title"]["text"]
        for one in packed
    )


def test_time_that_is_up_keeps_the_best_so_far(model_file, tmp_path):
    result = run(model_file, "--out", tmp_path, "--deadline", "0.01", "--structure", "p-pi", *QUICK)
    assert result.exit_code == 0, result.output
    content = strict(tmp_path / "pid.json")
    assert "time limit was reached" in " ".join(content["remarks"]) and content["structure"] == "p-pi"
    assert any(row["name"] == "Kv" and row["unit"] == "1/s" for row in content["drive"])


def test_notch_and_feed_forward_reach_file_and_export(model_file, tmp_path):
    arguments = ("--notch", "20,8,0.1", "--acceleration", "0.01", "--structure", "pd", "--export", *QUICK)
    result = run(model_file, "--out", tmp_path, *arguments)
    assert result.exit_code == 0, result.output
    content = strict(tmp_path / "pid.json")
    turn = 2 * math.pi
    assert content["notch"] == pytest.approx({"frequency": turn * 20, "width": turn * 8, "depth": 0.1})
    assert content["feed_forward"]["acceleration"] == 0.01
    assert (
        "notch" in content["control_law"]["equation"] and "acceleration" in content["control_law"]["equation"]
    )
    settings = load_pid(tmp_path / "pid.json").settings
    assert settings.notch == Notch(turn * 20, turn * 8, 0.1) and settings.acceleration == 0.01
    # The margins are of the loop with its notch.
    plant, gains = (
        behind(plant_of(load(model_file).chosen), settings.notch),
        load_pid(tmp_path / "pid.json").gains,
    )
    assert content["margins"]["maximum_sensitivity"] == pytest.approx(
        margins(plant, gains.vector).maximum_sensitivity, rel=1e-6
    )
    assert f".notch_b0 = {literal(float(settings.vector[14]))}," in (tmp_path / "pid.h").read_text()
    for said in ("2000", "20,8,0.1,3", "20,0", "fast"):
        assert run(model_file, "--out", tmp_path, "--notch", said).exit_code == 2


def test_compensation_wants_a_rig(model_file, tmp_path):
    result = run(model_file, "--out", tmp_path, "--compensate")
    assert result.exit_code == 2 and "--rig" in result.output


def test_friction_and_dead_band_of_the_rig_s_model():
    """A motor's friction is a command, a cylinder's is none; a diagnosed dead band is the valve's width."""
    emps = read_rig(DATA / "emps.toml")
    gains, settings = Gains(100.0, 0.0, 8.0, 2e-3), Settings(1e-3, -10, 10)
    found = friction_of(emps, "position", gains, settings, 0.2)
    assert found.friction == pytest.approx(30.0 / 35.1507, rel=0.1)
    assert dead_band_of(settings, emps) == settings
    bench = read_rig(DATA / "bench.toml")
    settings = Settings(1e-3, -5, 5)
    assert friction_of(bench, "position", Gains(60.0, 0.0, 1.0, 2e-3), settings, 0.06).friction == 0.0


def test_a_diagnosed_dead_band_is_jumped_over(tmp_path):
    text = (DATA / "bench.toml").read_text() + "\n[effects.valve_deadband]\nwidth = 0.03\n"
    (tmp_path / "rig.toml").write_text(text)
    found = dead_band_of(Settings(1e-3, -5, 5), read_rig(tmp_path / "rig.toml"))
    assert (found.deadband_low, found.deadband_high) == pytest.approx((-0.15, 0.15))
