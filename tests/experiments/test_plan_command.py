"""`optid plan` as a user calls it: a rig in, an experiment out that the rig can run and other commands read."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from optid import cli
from optid.core.readers import read_recording
from optid.live.excitation import read_command
from optid.live.reference import read_reference
from optid.live.settings import live_settings
from optid.rigs.rigfile import read_rig

DATA = Path(__file__).parents[2] / "data"
BENCH = DATA / "bench.toml"
RATE, SECONDS = 200, 7
GAINS = "kp=150 kd=30 derivative_filter=0.01"
RIVALS = ("delay@drive.command", "sensor_lag")
LIVE = """
[live]
command_limits = ["-10 V", "10 V"]
stroke_limits = ["-50 mm", "200 mm"]
"""


def run(*arguments):
    return CliRunner().invoke(cli.cli, [str(argument) for argument in arguments], prog_name="optid")


@pytest.fixture(scope="module")
def axis(tmp_path_factory):
    """An axis that starts away from the middle of its stroke limits, and is quick to simulate."""
    path = tmp_path_factory.mktemp("axis") / "axis.toml"
    text = (
        (DATA / "emps.toml")
        .read_text()
        .replace('model = "emps"', 'model = "emps"\noptions = { friction = "smooth" }')
    )
    path.write_text(text + LIVE)
    return path


@pytest.fixture(scope="module")
def planned(axis):
    out = axis.parent / "out"
    done = run(
        "plan",
        axis,
        "--rivals",
        ", ".join(RIVALS),
        "--seconds",
        SECONDS,
        "--rate",
        RATE,
        "--gains",
        GAINS,
        "--out",
        out,
    )
    assert done.exit_code == 0, done.stderr
    return out, done.stdout


def test_it_writes_its_files_and_says_what_they_are_worth(axis, planned):
    out, said = planned
    assert sorted(path.name for path in out.iterdir()) == [
        "experiment.csv",
        "manifest.json",
        "plan.json",
        "report.html",
        "tables.npz",
    ]
    assert all(name in said for name in RIVALS)
    assert f"optid live {axis} --reference {out / 'experiment.csv'} --seconds 7 --rate 200" in said
    assert f"--gains '{GAINS}'" in said


def test_the_experiment_is_a_recording_of_the_rig_within_its_limits(axis, planned):
    rig = read_rig(axis)
    record = read_recording(planned[0] / "experiment.csv", rig)
    limits = live_settings(rig).limits
    assert len(record) == RATE * SECONDS
    assert record.rate == pytest.approx(RATE)
    for role in ("reference", "position"):
        assert limits.stroke[0] <= record[role].values.min() < record[role].values.max() <= limits.stroke[1]
    command = record["command"].recorded
    assert limits.low <= command.min() < -0.5 < 0.5 < command.max() <= limits.high
    assert np.abs(np.diff(command)).max() <= limits.rate / RATE * (1 + 1e-9)


def test_the_live_loop_takes_it_as_its_reference(axis, planned):
    rig = read_rig(axis)
    path = planned[0] / "experiment.csv"
    reference, record = (
        read_reference(str(path), rig, live_settings(rig).limits, "m"),
        read_recording(path, rig),
    )
    assert reference.values == tuple(record["reference"].values)


def test_the_live_loop_puts_its_command_in_open_loop(axis, planned):
    rig = read_rig(axis)
    path = planned[0] / "experiment.csv"
    excitation = read_command(str(path), rig, live_settings(rig), "command", "V")
    assert excitation.values == (*read_recording(path, rig)["command"].recorded, 0.0)


def test_the_plan_separates_better_than_plain_steps(planned):
    document = json.loads((planned[0] / "plan.json").read_text())
    assert document["schema"] == "optid.plan/1"
    assert {(row["there"], row["instead"]) for row in document["pairs"]} == {RIVALS, RIVALS[::-1]}
    least, plain = (min(row[key] for row in document["pairs"]) for key in ("sd", "sd_plain_steps"))
    assert least > 2.0 * plain
    for row in document["pairs"]:
        longer = max(1.0, (document["needed_sd"] / row["sd"]) ** 2)
        assert row["seconds_needed"] == pytest.approx(SECONDS * longer)
    smallest = {row["effect"]: row["smallest"] for row in document["rivals"]}
    assert smallest["sensor_lag"] == {"time_constant": {"value": 4e-4, "unit": "s"}}
    assert [(piece["from"], piece["to"]) for piece in document["pieces"]] == [(1.0, 4.0), (4.0, 7.0)]


def test_the_way_from_the_start_to_the_middle_comes_first(axis, planned):
    record = read_recording(planned[0] / "experiment.csv", read_rig(axis))
    reference = record["reference"].values
    assert reference[[0, RATE, -1]] == pytest.approx([0.0, 0.075, 0.075])
    assert np.all(np.diff(reference[: RATE + 1]) >= 0)


def test_the_report_stands_alone_and_names_the_rivals(planned):
    page = (planned[0] / "report.html").read_text()
    assert '<div class="figure"' in page
    assert all(name in page for name in RIVALS)
    assert "src=" not in page


def test_one_rival_is_shown_best_and_pressures_are_used_where_mapped(tmp_path):
    text = BENCH.read_text() + 'pressure_a = { column = "pa", unit = "bar_gauge" }\n'
    (tmp_path / "rig.toml").write_text(text + '\n[live]\nstroke_limits = ["-20 mm", "90 mm"]\n')
    (tmp_path / "diagnosis.json").write_text(
        json.dumps(
            {
                "schema": "optid.diagnosis/1",
                "findings": [],
                "not_testable": [{"effect": "supply_droop"}],
            }
        )
    )
    done = run(
        "plan",
        tmp_path / "rig.toml",
        "--diagnosis",
        tmp_path,
        "--seconds",
        2,
        "--rate",
        100,
        "--out",
        tmp_path / "out",
    )
    assert done.exit_code == 0, done.stderr
    document = json.loads((tmp_path / "out" / "plan.json").read_text())
    [row] = document["pairs"]
    assert (row["there"], row["instead"]) == ("supply_droop", None)
    assert row["sd"] > 0
    assert document["noise"]["pressure_a"] == pytest.approx(100.0)
    rig = read_rig(tmp_path / "rig.toml")
    record = read_recording(tmp_path / "out" / "experiment.csv", rig)
    assert record["pressure_a"].values[0] == pytest.approx(4e5)
    assert record["position"].values[0] == pytest.approx(0.0)  # where the model starts: not the middle
    assert -0.02 <= record["position"].values.min() < record["position"].values.max() <= 0.09


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([BENCH], "--rivals, --diagnosis: neither"),
        ([BENCH, "--rivals", "valve_lag", "--diagnosis", "x"], "both"),
        ([BENCH, "--rivals", "valve_leg,input_delay"], 'did you mean "valve_lag"?'),
        ([BENCH, "--diagnosis", "nowhere"], "nowhere"),
        ([BENCH, "--rivals", "valve_lag", "--seconds", "nan"], "--seconds"),
        ([BENCH, "--rivals", "valve_lag", "--seconds", "0.02"], "samples a piece"),
        ([BENCH, "--rivals", "valve_lag", "--rate", "1e9"], "at most"),
        ([BENCH, "--rivals", "valve_lag", "--gains", "kq=3"], "kq"),
        ([BENCH, "--rivals", "valve_lag", "--effects", "nope.py"], "nope.py"),
        (["nope.toml", "--rivals", "valve_lag"], "nope.toml"),
        ([DATA / "cascaded_tanks.toml", "--rivals", "overflow"], 'no output "position"'),
        ([DATA / "emps.toml", "--rivals", "valve_lag"], "live.command_limits"),
    ],
    ids=lambda value: " ".join(map(str, value[1:])) if isinstance(value, list) else "",
)
def test_a_wrong_call_is_one_line_and_leaves_nothing(tmp_path, monkeypatch, arguments, said):
    monkeypatch.chdir(tmp_path)
    done = run("plan", *arguments, "--out", "new")
    assert done.exit_code == 2, done.output
    assert len(done.stderr.strip().splitlines()) == 1
    assert said in done.stderr
    assert not (tmp_path / "new").exists()


def test_a_rig_needs_a_stroke_and_a_reference(tmp_path):
    axis = (DATA / "emps.toml").read_text() + '\n[live]\ncommand_limits = ["-10 V", "10 V"]\n'
    for text, said in (
        (axis, "live.stroke_limits"),
        (BENCH.read_text().replace("reference =", "# "), "channels.reference"),
    ):
        (tmp_path / "rig.toml").write_text(text)
        done = run("plan", tmp_path / "rig.toml", "--rivals", "input_delay", "--out", tmp_path / "out")
        assert done.exit_code == 2
        assert said in done.stderr
