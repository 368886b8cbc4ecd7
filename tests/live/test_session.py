"""The whole command in its processes: ends, signals and deaths. What is asserted never depends on speed."""

import json
import multiprocessing
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from optid import cli
from optid.armax.forgetting import Directional
from optid.armax.identifier import Identifier, Method
from optid.armax.identifier import Settings as Learning
from optid.armax.structure import Orders
from optid.core.readers import read_recording
from optid.errors import InputError
from optid.live.events import Events
from optid.live.excitation import Excitation
from optid.live.loop import Choices
from optid.live.plan import Plan
from optid.live.processes import _heed
from optid.live.reference import read_profile, tour
from optid.live.session import Session
from optid.live.settings import live_settings, wiring_of
from optid.pid.controller import Gains
from optid.rigs.rigfile import read_rig

BENCH = Path(__file__).resolve().parents[2] / "data" / "bench.toml"
posix = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")


def run(*arguments):
    return CliRunner().invoke(cli.cli, ["live", *map(str, arguments)], prog_name="optid")


def test_the_whole_command(tmp_path):
    out = tmp_path / "out"
    asked = [
        "--na",
        "3",
        "--nb",
        "2",
        "--nc",
        "1",
        "--delay",
        "2",
        "--method",
        "rls",
        "--forgetting",
        "directional:0.999",
    ]
    result = run(BENCH, "--out", out, "--fast", "--seconds", 4, *asked)
    assert result.exit_code == 0, result.output
    document = json.loads((out / "live.json").read_text())
    assert (document["outcome"], document["samples"], document["missed"]) == ("done", 4000, 0)
    assert document["safe"]
    assert "stribeck friction (breakaway ratio 1.3" in document["hides"]
    assert document["followed"] is None  # four seconds say nothing
    assert document["fit_percent"]["predicted"] > 99
    record = read_recording(out / "recording.csv", read_rig(BENCH))
    assert len(record) == 4000
    identified = json.loads((out / "armax.json").read_text())
    assert identified["recommended"] == 3
    model = identified["models"][0]
    assert [model[name] for name in ("na", "nb", "nc", "nk")] == [3, 2, 1, 2]
    learning = Learning(Method.EXTENDED_LEAST_SQUARES, Directional(0.999))
    again = Identifier(Orders(3, (2,), 1, (2,)), 1e-3, learning, scales=(0.234 / 4, 2.5))
    again.run(record["position"].values, record["command"].values)
    said = [*model["a"][1:], *model["b"], *model["c"][1:]]
    np.testing.assert_allclose(said, again.theta, rtol=1e-2, atol=1e-2 * np.abs(again.theta).max())
    report = (out / "report.html").read_text()
    assert "The step at 2.00 s" in report
    assert report.count('<div class="figure"') == 2


def wait_for(session, there):
    """Poll a session until something is so: a tuning takes half a minute on a machine that does nothing else."""
    for _ in range(6000):
        session.poll()
        if there():
            return
        time.sleep(0.05)
    raise AssertionError("nothing happened for five minutes")


@pytest.mark.full
def test_tune_review_apply(tmp_path, patient):
    settings = live_settings(read_rig(patient), 250.0)
    plan = Plan(
        patient, "simulated", tmp_path, tour(settings.limits), Choices(Gains(6.0)), rate=250.0, fast=True
    )
    session = Session(plan)
    try:
        session.go()
        assert not session.applicable
        session.apply()  # nothing to apply
        wait_for(session, lambda: session.slow.count > 200)  # 10 s of the session
        session.tune()
        assert session.busy
        session.tune()  # one at a time
        wait_for(session, lambda: not session.busy)
        review = session.tuning.review
        assert review.old == Gains(6.0)
        old, new = review.responses["identified"]
        assert new.measures["itae"] < 0.5 * old.measures["itae"]
        assert review.better
        session.apply()
        wait_for(session, lambda: session.gains == review.new)
        assert not session.applicable
        session.stop("enough")
        wait_for(session, lambda: session.end is not None)
    finally:
        session.close()
    assert (session.end["why"], session.end["safe"]) == ("enough", True)
    words = [event.words for event in session.events]
    assert sum(line.startswith("tuning on") for line in words) == 1
    assert sum(line.startswith("applied: kp") for line in words) == 1
    log = pd.read_csv(tmp_path / "recording.csv")
    moved = (
        log["r"].diff().ne(0.0).rolling(150, min_periods=1).sum() > 0
    )  # within 0.3 s of a demand: at its rate limit
    jump = log["u"].diff().abs()[~moved]
    assert len(jump) > 1000
    assert jump.max() < 1.0  # V: neither the change of gains nor anything else but the demand makes it jump


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--driver", "nosuch"), "no driver"),
        (("--driver", "replay"), "no recording to replay"),
        (("--gains", "kq=3"), 'no gain "kq"'),
        (("--gains", "nothing.json"), "no such file"),
        (("--reference", "4 kg"), "--reference"),
        (("--reference", "400 mm"), "beyond the stroke limits"),
        (("--driver", "opcua", "--fast"), "--fast"),
        (("--delay", "0"), "--delay"),
        (("--order", "3", "--na", "3"), "given together with --order"),
        (("--forgetting", "0.2"), "expected a factor from 0.5 to 1"),
    ],
)
def test_wrong_calls_are_refused_in_one_line(tmp_path, arguments, words):
    result = run(BENCH, "--out", tmp_path / "out", "--seconds", 1, *arguments)
    assert result.exit_code == 2, result.output
    assert words in result.stderr
    assert "Traceback" not in result.output


def test_a_port_that_is_taken_is_said_before_anything_begins(tmp_path):
    pytest.importorskip("aiohttp")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        result = run(BENCH, "--out", tmp_path / "out", "--page", "--port", port)
    assert result.exit_code == 2
    assert "the page cannot be served at 127.0.0.1" in result.stderr
    assert not (tmp_path / "out").exists()


def test_a_demand_reaches_the_loop(bench):
    here, there = multiprocessing.Pipe()
    session, heard = Session.__new__(Session), []
    session.plan = SimpleNamespace(choices=Choices(Gains(20.0)))
    session.settings, session.wiring = live_settings(bench), wiring_of(bench)
    session._pipes, session.events = [None, here], Events()
    session.demand("square 20 mm 0.5 Hz")
    assert _heed(SimpleNamespace(demand=heard.append), there)
    assert heard == [read_profile("square 20 mm 0.5 Hz", session.settings.limits, "m")]
    assert (session.demanded, session.events.number) == ("square 20 mm 0.5 Hz", 1)
    with pytest.raises(InputError, match="beyond the stroke limits"):
        session.demand("1 m")
    session.plan = SimpleNamespace(choices=Choices(Gains(0.0), command=Excitation((0.0,), (0.0,))))
    with pytest.raises(InputError, match="the loop is open"):
        session.demand("1 mm")
    assert not there.poll(0)


@pytest.mark.parametrize("option", [("--token", "abc"), ("--host", "127.0.0.1"), ("--port", 0)])
def test_an_option_of_the_page_is_never_ignored(tmp_path, option):
    result = run(BENCH, "--out", tmp_path / "out", *option, "--seconds", 1)
    assert result.exit_code == 2
    assert f"{option[0]}: it is given without --page" in result.stderr


def test_an_older_recording_is_never_overwritten(tmp_path):
    (tmp_path / "recording.csv").write_text("precious")
    result = run(BENCH, "--out", tmp_path, "--seconds", 1)
    assert result.exit_code == 2
    assert (tmp_path / "recording.csv").read_text() == "precious"


STUCK = """
import os, time
from pathlib import Path

class Rig:
    def __init__(self, order):
        self.reads, self.put = 0, order.rig.path.with_name("put.txt")

    def read(self, time_):
        self.reads += 1
        if self.reads > 30:
            time.sleep(1e6)
        return [0.0]

    def write(self, command, time_):
        with self.put.open("a") as file:
            file.write(f"{os.getpid()} {command}\\n")
        return command

    def close(self):
        pass
"""


def test_a_driver_that_never_comes_back_is_left_and_the_safe_command_put_anew(tmp_path):
    rig, driver = tmp_path / "rig.toml", tmp_path / "stuck.py"
    rig.write_text(BENCH.read_text() + '\n[live]\nsafe_command = "0.25 V"\nwatchdog = "0.3 s"\n')
    driver.write_text(STUCK)
    result = run(rig, "--driver", f"{driver}:Rig", "--out", tmp_path / "out")
    assert result.exit_code == 1
    assert (
        "the driver did not respond; the safe command was written through a new connection" in result.stderr
    )
    lines = (tmp_path / "put.txt").read_text().split("\n")
    assert lines[-2] == f"{os.getpid()} 0.25"  # by this process, when the guard was gone
    rows = pd.read_csv(tmp_path / "out" / "recording.csv")
    # A period that passed without a sample has a row without a measurement.
    assert rows["x"].notna().sum() == 30


class Running:
    """The command in a process of its own, with samples already taken."""

    def __init__(self, rig, out):
        call = [sys.executable, "-m", "optid.cli", "live", str(rig), "--out", str(out), "--rate", "200"]
        self.out, self.process = out, subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)

    def begun(self):
        """Samples have been taken."""
        self._until(lambda: self.rows() > 20 or self.process.poll() is not None)
        assert self.process.poll() is None, self.process.stdout.read()

    def rows(self):
        path = self.out / "recording.csv"
        return path.read_text().count("\n") if path.is_file() else 0

    def _until(self, there):
        for _ in range(6000):
            if there():
                return
            time.sleep(0.05)
        raise AssertionError("nothing happened for five minutes")

    def children(self):
        """Processes named by what they run: guard and loop are started one after the other."""
        found = subprocess.run(
            ["pgrep", "-f", "-P", str(self.process.pid), "spawn_main"], capture_output=True
        )
        return sorted(int(word) for word in found.stdout.split())

    def ended(self):
        """How the session ended, once the guard has written it."""
        path = self.out / "guard.json"
        self._until(path.is_file)
        return json.loads(path.read_text())


@pytest.fixture
def running(tmp_path, patient):
    started = Running(patient, tmp_path / "out")
    with started.process:
        try:
            started.begun()
            yield started
        finally:
            if started.process.poll() is None:
                started.process.kill()


@posix
@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.full)])
def test_a_signal_stops_it_in_good_order(running, number):
    running.process.send_signal(number)
    assert running.process.wait(60) == 0
    document = json.loads((running.out / "live.json").read_text())
    assert (document["outcome"], document["safe"]) == ("stopped", True)
    log = pd.read_csv(running.out / "recording.csv")
    assert document["samples"] <= len(log) <= document["samples"] + document["missed"]
    assert log["t"].is_monotonic_increasing


@posix
def test_the_guard_outlives_the_death_of_the_session(running):
    running.process.kill()
    end = running.ended()
    assert (end["how"], end["safe"]) == ("stopped", True)
    assert "the session that started it has ended" in end["why"]
    log = pd.read_csv(running.out / "recording.csv")
    assert len(log) >= end["samples"]


@posix
@pytest.mark.parametrize(
    ("victim", "words"), [(0, "the guard's process died"), (1, "the loop process ended")]
)
def test_the_death_of_a_process_is_a_failed_session(running, victim, words):
    os.kill(running.children()[victim], signal.SIGKILL)
    assert running.process.wait(60) == 1
    document = json.loads((running.out / "live.json").read_text())
    assert (document["outcome"], document["safe"]) == ("failed", True)
    assert words in document["why"]
    assert len(pd.read_csv(running.out / "recording.csv")) > 10


def test_a_fast_session_tunes_in_its_own_time_and_waits_meanwhile(tmp_path, monkeypatch):
    def at_once(self, case):
        self._note("tuned here")

    monkeypatch.setattr("optid.live.tuning.Tuning.begin", at_once)
    out = tmp_path / "out"
    result = run(BENCH, "--out", out, "--fast", "--rate", 100, "--seconds", 4, "--tune", 3)
    assert result.exit_code == 0, result.output
    document = json.loads((out / "live.json").read_text())
    assert document["samples"] == 400
    times = {event["words"]: event["time"] for event in document["events"]}
    assert times["tuned here"] == pytest.approx(3.0, abs=0.02)
    assert max(times.values()) == pytest.approx(4.0, abs=0.02)


def test_a_session_that_failed_at_the_start_stops_no_other(tmp_path):
    rig, driver, out = tmp_path / "rig.toml", tmp_path / "shy.py", tmp_path / "out"
    rig.write_text(BENCH.read_text())
    driver.write_text(STUCK.replace("if self.reads > 30:", "if True:").replace("time.sleep(1e6)", "1 / 0"))
    result = run(rig, "--driver", f"{driver}:Rig", "--out", out)
    assert result.exit_code == 1
    assert "ZeroDivisionError" in result.stderr
    assert not (out / "recording.csv").exists()  # which would stop the next session
