"""Drivers: replay, a user's own, NI cards through NI's own interface, OPC UA against a real server on loopback."""

import math
import socket
import time
from contextlib import closing
from unittest import mock

import numpy as np
import pandas as pd
import pytest

from optid.errors import InputError, RigError
from optid.live.driver import find_driver, open_driver
from optid.live.loop import Choices
from optid.live.settings import live_settings, wiring_of
from optid.pid.controller import Gains
from optid.rigs.rigfile import read_rig


def with_live(rig, tmp_path, table):
    """The rig file with a table of its own."""
    path = tmp_path / "rig.toml"
    path.write_text(f"{rig.source}\n{table}\n", encoding="utf-8")
    return read_rig(path)


def opened(name, rig, recording=None):
    order = {"wiring": wiring_of(rig), "settings": live_settings(rig), "recording": recording, "seed": 0}
    return open_driver(name, rig, order)


# Replay.


def test_a_replay_shows_the_recording_and_heeds_no_command(bench, run_live):
    recording = bench.path.with_name("bench.csv")
    source = pd.read_csv(recording)
    rows = len(source)
    end, loop, path = run_live(bench, "replay", seconds=rows * 1e-3 + 1.0, recording=recording)
    log = pd.read_csv(path)
    assert (end.how.name, end.samples) == ("ENDED", rows)
    np.testing.assert_allclose(log["x"], source["x"], rtol=1e-8)
    np.testing.assert_allclose(log["u"], source["u"], atol=1e-8)
    assert loop.identifier.counts.learnt_from > 0.9 * rows


def test_what_a_session_logs_can_be_replayed_to_the_same_identified_model(bench, run_live):
    choices = Choices(Gains(30.0), dither=0.1)
    _, first, path = run_live(bench, seconds=3.0, choices=choices)
    _, again, _ = run_live(bench, "replay", seconds=5.0, recording=path, choices=choices)
    np.testing.assert_allclose(again.identifier.theta, first.identifier.theta, rtol=1e-3, atol=1e-3)


# A user's own.

OWN = '''
from pathlib import Path

assert Path(__file__).is_absolute()


class Lag:
    """A first-order axis."""

    def __init__(self, order):
        self.x, self.u = 0.0, 0.0

    def read(self, time):
        self.x += 1e-3 * 400.0 * self.u
        return [self.x]

    def write(self, command, time):
        self.u = 0.02 * round(command / 0.02)  # a coarse converter
        return self.u

    def close(self):
        pass


def broken(order):
    return 1 / 0
'''


def test_a_drivers_file_is_all_a_user_writes(bench, tmp_path, run_live):
    (tmp_path / "mine.py").write_text(OWN, encoding="utf-8")
    choices = Choices(Gains(20.0, 10.0))  # with an integral, which a converter's rounding must not start anew
    _, _, path = run_live(bench, f"{tmp_path}/mine.py:Lag", seconds=4.0, choices=choices)
    late = pd.read_csv(path).query("3.5 < t < 4")
    assert late["x"].to_numpy() == pytest.approx(late["r"].to_numpy(), abs=5.0)  # mm; it follows


def test_a_drivers_file_that_raises_is_told_by_its_line(bench, tmp_path):
    (tmp_path / "mine.py").write_text(OWN, encoding="utf-8")
    with pytest.raises(RigError, match=r"ZeroDivisionError.*\(line 26\)"):
        opened(f"{tmp_path}/mine.py:broken", bench)
    with pytest.raises(InputError, match='did you mean "broken"'):
        find_driver(f"{tmp_path}/mine.py:brokn")


# NI cards.

CARDS = """
[live.nidaqmx]
command = { channel = "Dev1/ao0" }
position = { channel = "Dev1/ai0", per_volt = "52 mm", zero = "2.5 V", range = ["0 V", "5 V"], terminal = "RSE" }
"""


@pytest.fixture
def card(monkeypatch):
    """NI's package with a stand-in for the driver below it: every call is held to NI's own signatures.

    A clocked card acquires in its own time: a buffer that old samples fall out of, and NI's errors for what has not
    been acquired, not yet, or no more.
    """
    nidaqmx = pytest.importorskip("nidaqmx")
    from nidaqmx import stream_readers, stream_writers
    from nidaqmx.constants import OverwriteMode, ReadRelativeTo
    from nidaqmx.task import InStream
    from nidaqmx.task._timing import Timing
    from nidaqmx.task.collections import AIChannelCollection, AOChannelCollection

    real, Reader, Writer = (
        nidaqmx.Task,
        stream_readers.AnalogMultiChannelReader,
        stream_writers.AnalogSingleChannelWriter,
    )

    class Card:
        volts, slope, now, put, tasks = 3.0, 0.0, 0.0, [], []

        @staticmethod
        def sleep(seconds):
            Card.now += seconds

    def refused(code):
        return nidaqmx.errors.DaqReadError(f"error {code}", code, 0)

    def task(*arguments, **names):
        made = mock.create_autospec(real, instance=True)
        made.ai_channels = mock.create_autospec(AIChannelCollection, instance=True)
        made.ao_channels = mock.create_autospec(AOChannelCollection, instance=True)
        made.timing = mock.create_autospec(Timing, instance=True)
        made.in_stream = mock.create_autospec(InStream, instance=True)
        made.start.side_effect = lambda: setattr(made, "begun", Card.now)
        made.in_stream.overwrite = OverwriteMode.DO_NOT_OVERWRITE_UNREAD_SAMPLES  # as a new task has it
        made.in_stream.relative_to = ReadRelativeTo.CURRENT_READ_POSITION
        made.unread = 0
        Card.tasks.append(made)
        return made

    def reader(stream):
        made = mock.create_autospec(Reader, instance=True)

        def read(data, timeout):
            data[:] = Card.volts

        def read_many(data, number_of_samples_per_channel, timeout):
            (of,) = [one for one in Card.tasks if one.in_stream is stream]
            timing, wanted = of.timing.cfg_samp_clk_timing.call_args, number_of_samples_per_channel
            (rate,), buffered = timing.args, timing.kwargs["samps_per_chan"]
            acquired = math.floor((Card.now - of.begun) * rate + 1e-6)
            newest = stream.relative_to is ReadRelativeTo.MOST_RECENT_SAMPLE
            first = acquired + stream.offset if newest else of.unread
            if first < 0:
                raise refused(-200277)
            if (missing := first + wanted - acquired) > 0:
                Card.now += min(missing / rate, timeout)
                if missing / rate > timeout:
                    raise refused(-200284)
                acquired = first + wanted
            if first < acquired - buffered or (
                stream.overwrite is OverwriteMode.DO_NOT_OVERWRITE_UNREAD_SAMPLES
                and of.unread < acquired - buffered
            ):
                raise refused(-200279)
            of.unread = first + wanted
            times = of.begun + (1 + first + np.arange(wanted)) / rate
            data[:] = Card.volts + Card.slope * (times - Card.now)

        made.read_one_sample.side_effect = read
        made.read_many_sample.side_effect = read_many
        return made

    def writer(stream, auto_start):
        made = mock.create_autospec(Writer, instance=True)
        made.write_one_sample.side_effect = lambda data, timeout: Card.put.append(data)
        return made

    Card.put, Card.tasks = [], []
    monkeypatch.setattr("optid.live.drivers.nidaqmx.clock", Card)
    monkeypatch.setattr(nidaqmx, "Task", task)
    monkeypatch.setattr(stream_readers, "AnalogMultiChannelReader", reader)
    monkeypatch.setattr(stream_writers, "AnalogSingleChannelWriter", writer)
    return Card


def test_cards_read_and_put_volts(bench, tmp_path, card):
    import nidaqmx.constants

    driver = opened("nidaqmx", with_live(bench, tmp_path, CARDS))
    assert list(driver.read(0.0)) == pytest.approx([26.0])  # (3 - 2.5) V * 52 mm/V
    assert driver.write(1.25, 0.0) == 1.25
    assert driver.write(7.0, 0.0) == 5.0  # the line's own span
    assert card.put == [1.25, 5.0]
    inputs = card.tasks[0].ai_channels.add_ai_voltage_chan.call_args
    assert inputs.args == ("Dev1/ai0",)
    assert inputs.kwargs["terminal_config"] is nidaqmx.constants.TerminalConfiguration.RSE
    assert (inputs.kwargs["min_val"], inputs.kwargs["max_val"]) == (0.0, 5.0)
    driver.close()
    assert all(task.close.called for task in card.tasks)


@pytest.mark.parametrize(("said", "rate"), [("", 8000.0), ('sample_rate = "50 kHz"', 50e3)])
def test_cards_average_their_newest_samples(bench, tmp_path, card, said, rate):
    driver = opened("nidaqmx", with_live(bench, tmp_path, f"{CARDS}average = 8\n{said}"))
    card.slope = 10.0  # V/s
    delay = 3.5 / rate  # s: half of eight samples
    for pause in (0.0, 1e-3, 1.3e-3, 20.0, 1e-3):  # a session that stood still for long reads on
        card.now += pause
        before = card.now
        (value,) = driver.read(0.0)
        assert card.now == before  # it waits for nothing
        age = delay + (card.now * rate + 1e-6) % 1.0 / rate
        assert value == pytest.approx((3.0 - 10.0 * age - 2.5) * 52.0, abs=1e-3)
    driver.close()
    assert all(task.close.called for task in card.tasks)


def test_cards_run_a_session(bench, tmp_path, card, run_live):
    end, _, path = run_live(with_live(bench, tmp_path, CARDS), "nidaqmx", seconds=0.1)
    assert end.samples == 100
    assert pd.read_csv(path)["x"].tolist() == pytest.approx([26.0] * 100)
    assert card.put[0] == card.put[-1] == 0.0


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("[live.nidaqmx]\ncommand = { channel = 'Dev1/ao0' }", "live.nidaqmx.position: missing"),
        (CARDS.replace('per_volt = "52 mm", ', ""), 'per_volt = "1 m"'),
        (CARDS.replace("RSE", "RSI"), "terminal"),
        (CARDS.replace("52 mm", "52 kg"), "per_volt"),
        (CARDS.replace("position", "pasition"), "pasition"),
        (CARDS + "average = 0", "average.*whole number"),
        (CARDS + 'average = 8\nsample_rate = "5 kHz"', "at least 8000 Hz"),
        (CARDS + 'sample_rate = "5 kHz"', "average = 8"),
    ],
)
def test_wrong_lines_are_refused(bench, tmp_path, table, words):
    with pytest.raises(RigError, match=words):
        opened("nidaqmx", with_live(bench, tmp_path, table))


def test_a_machine_without_cards_says_so(bench, tmp_path):
    nidaqmx = pytest.importorskip("nidaqmx")
    try:
        nidaqmx.system.System.local().driver_version  # noqa: B018
    except Exception:
        with pytest.raises(RigError, match="the card says"):
            opened("nidaqmx", with_live(bench, tmp_path, CARDS))
    else:
        pytest.skip("this machine has NI's driver")


# OPC UA.

NODES = """
[live.opcua]
url = "{url}"
command = "ns=2;s=Command"
position = "ns=2;s=Position"
heartbeat = "ns=2;s=Alive"
"""


@pytest.fixture
def server():
    """A real server with three nodes; the axis there moves with the command's sign."""
    sync, ua = pytest.importorskip("asyncua.sync"), pytest.importorskip("asyncua.ua")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    running = sync.Server()
    running.set_endpoint(f"opc.tcp://127.0.0.1:{port}")
    running.set_security_policy([ua.SecurityPolicyType.NoSecurity])
    running.register_namespace("urn:optid:test")
    rig = running.nodes.objects.add_object(ua.NodeId("Rig", 2), "2:Rig")
    nodes = {
        "Position": rig.add_variable(ua.NodeId("Position", 2), "2:Position", 12.5),
        "Command": rig.add_variable(ua.NodeId("Command", 2), "2:Command", 0.0, ua.VariantType.Float),
        "Whole": rig.add_variable(ua.NodeId("Whole", 2), "2:Whole", 0, ua.VariantType.Int16),
        "Alive": rig.add_variable(ua.NodeId("Alive", 2), "2:Alive", 0, ua.VariantType.Int16),
    }
    for name in ("Command", "Whole", "Alive"):
        nodes[name].set_writable()
    running.start()
    running.url, running.own, running.up = f"opc.tcp://127.0.0.1:{port}", nodes, True
    yield running
    if running.up:
        running.stop()


def test_a_server_is_read_and_written(bench, tmp_path, server):
    ua, table = pytest.importorskip("asyncua.ua"), NODES.format(url=server.url)
    with closing(opened("opcua", with_live(bench, tmp_path, table))) as driver:
        assert list(driver.read(0.0)) == [12.5]
        for _ in range(3):
            assert driver.write(1.5, 0.0) == 1.5
        assert server.own["Command"].read_value() == 1.5
        assert server.own["Alive"].read_value() == 3
        assert (
            driver.write(0.1, 0.0) == float(np.float32(0.1)) != 0.1
        )  # what a node of single precision holds
        assert driver.resolution == 0.0
        codes = ua.StatusCodes
        for code in (codes.UncertainLastUsableValue, codes.BadSensorFailure, codes.Good):
            value = ua.DataValue(ua.Variant(12.5, ua.VariantType.Double), ua.StatusCode(code))
            server.own["Position"].write_value(value)
            np.testing.assert_equal(list(driver.read(0.0)), [12.5 if code == codes.Good else np.nan])
    with closing(opened("opcua", with_live(bench, tmp_path, table.replace("s=Command", "s=Whole")))) as whole:
        assert whole.resolution == 1.0
        assert [whole.write(u, 0.0) for u in (0.4, 1.7, -2.6)] == [0.0, 2.0, -3.0]
        assert server.own["Whole"].read_value() == -3


def test_a_server_runs_a_session(bench, tmp_path, server, run_live):
    end, _, path = run_live(with_live(bench, tmp_path, NODES.format(url=server.url)), "opcua", seconds=0.05)
    assert (end.samples, end.safe) == (50, True)
    assert pd.read_csv(path)["x"].tolist() == [12.5] * 50
    assert server.own["Command"].read_value() == 0.0
    assert server.own["Alive"].read_value() == 52  # a safe command before and after


def test_a_lost_link_ends_the_session_and_says_so(bench, tmp_path, server, run_live):
    class Cut:
        """A demanded position on the way to which the server goes away."""

        period = None

        def at(self, when):
            if when >= 0.02 and server.up:
                server.up = False
                server.stop()
            return 0.0

    started = time.monotonic()
    end, _, path = run_live(
        with_live(bench, tmp_path, NODES.format(url=server.url)), "opcua", seconds=9.0, reference=Cut()
    )
    assert end.how.name == "FAILED"
    assert "LinkLost" in end.why
    assert "the safe command could not be written" in end.why
    assert not end.safe
    assert len(pd.read_csv(path)) >= 20
    assert time.monotonic() - started < 60


def test_no_server_is_a_refusal(bench, tmp_path):
    pytest.importorskip("asyncua")
    with pytest.raises(RigError, match="cannot be used"):
        opened("opcua", with_live(bench, tmp_path, NODES.format(url="opc.tcp://127.0.0.1:9")))
