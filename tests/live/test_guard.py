"""Whatever goes wrong, the safe command is put and the log holds every sample up to the last."""

import math
from dataclasses import replace

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from optid.core.recording import ChannelMap
from optid.live.clock import FastClock
from optid.live.driver import EndOfData
from optid.live.failsafe import Failsafe
from optid.live.guard import Guard, How, Stop
from optid.live.log import Layout, Log
from optid.live.messages import LoopLost, Reply
from optid.live.motion_limiter import MotionLimiter
from optid.live.settings import Limits, Settings, Wiring

SAFE = 0.5
LIMITS = Limits(-5.0, 5.0, rate=1000.0, safe=SAFE, stroke=(-0.1, 0.1))
SETTINGS = Settings(1000.0, LIMITS, watchdog=0.005)
WIRING = Wiring(
    ChannelMap("command", "u", "V", "1", factor=1 / 5, per_unit=5.0, recorded_unit="V"),
    (ChannelMap("position", "x", "mm", "m", factor=1e-3, recorded_unit="m"),),
    ChannelMap("time", "t", "s", "s"),
)


class Rig:
    """A driver that fails when told to."""

    def __init__(self, position=0.0, read=None, write=None):
        self.position, self.put, self.reads = position, [], 0
        self._read, self._write = read or {}, write or {}

    def read(self, time):
        self.reads += 1
        if self.reads in self._read:
            raise self._read[self.reads]
        return [1e3 * self.position]

    def write(self, command, time):
        if len(self.put) in self._write:
            raise self._write.pop(len(self.put))
        self.put.append(command)
        return command

    def close(self):
        pass


class Loop:
    """A link whose other end wishes what it is told; ``None`` is silence, an exception is raised."""

    def __init__(self, wishes):
        self.wishes = wishes

    def send(self, sample):
        self.sample = sample

    def receive(self, number, timeout):
        wish = self.wishes(number)
        if isinstance(wish, Exception):
            raise wish
        return None if wish is None else Reply(number, wish, 0.0, 0.0, 0.0, 0.0, 1e-5)


class LateClock(FastClock):
    """One sample takes so long that the next two are over."""

    def left(self, sample, share):
        return 0.0 if sample in (3, 4) else 1e-3


@pytest.fixture
def guarded(tmp_path):
    def run(rig, wishes, samples=20, asked=lambda: None, clock=None):
        log = Log(tmp_path / "log.csv", Layout(WIRING).columns)
        guard = Guard(rig, Loop(wishes), clock or FastClock(1e-3), WIRING, SETTINGS, log)
        end = guard.run(samples, asked)
        log.close()
        return end, pd.read_csv(tmp_path / "log.csv")

    return run


def test_a_sound_session_is_logged_whole_and_ends_safe(guarded):
    rig = Rig()
    end, log = guarded(rig, lambda n: 0.5 + 0.01 * n)
    assert (end.how, end.samples, end.missed, end.held_back, end.safe) == (How.DONE, 20, 0, 0, True)
    assert log["u"].tolist() == pytest.approx([0.5 + 0.01 * n for n in range(20)])
    assert log["t"].tolist() == pytest.approx([1e-3 * n for n in range(20)])
    assert rig.put[0] == rig.put[-1] == SAFE


@pytest.mark.parametrize(
    ("rig", "wishes", "how", "samples", "words"),
    [
        (Rig(read={8: OSError("cable")}), lambda n: 1.0, How.FAILED, 7, "OSError: cable"),
        (Rig(read={8: SystemExit("bye")}), lambda n: 1.0, How.FAILED, 7, "SystemExit: bye"),
        (Rig(read={8: EndOfData("over")}), lambda n: 1.0, How.ENDED, 7, "over"),
        (Rig(write={8: OSError("cable")}), lambda n: 1.0, How.FAILED, 7, "OSError: cable"),
        (Rig(), lambda n: LoopLost("gone") if n == 7 else 1.0, How.FAILED, 7, "the loop process ended"),
        (Rig(), lambda n: None if n >= 7 else 1.0, How.FAILED, 12, "the loop does not respond"),
        (Rig(position=math.nan), lambda n: 1.0, How.FAILED, 5, "the position sensor gives no value"),
    ],
)
def test_every_failure_ends_with_the_safe_command(guarded, rig, wishes, how, samples, words):
    end, log = guarded(rig, wishes)
    assert end.how is how
    assert words in end.why
    assert end.safe
    assert rig.put[-1] == SAFE
    assert samples <= len(log) <= samples + 1  # the one in which it failed may be there or not


def test_somebody_stops_it(guarded):
    rig, calls = Rig(), []

    def asked():
        calls.append(1)
        if len(calls) == 6:
            raise Stop("Ctrl-C")

    end, log = guarded(rig, lambda n: 1.0, asked=asked)
    assert (end.how, end.why, len(log), rig.put[-1]) == (How.STOPPED, "Ctrl-C", 5, SAFE)


@pytest.mark.parametrize(
    ("position", "words"),
    [(math.inf, "position reads inf"), (-1e67, "far beyond the stroke"), (2.1, "far beyond the stroke")],
)
def test_a_reading_that_no_sensor_gives_ends_it_at_once(guarded, position, words):
    class Mad(Rig):
        def read(self, time):
            if self.reads == 7:
                self.position = position
            return super().read(time)

    rig = Mad()
    end, log = guarded(rig, lambda n: 1.0)
    assert (end.how, end.safe, len(log), rig.put[-1]) == (How.FAILED, True, 7, SAFE)
    assert words in end.why


def test_another_sensor_that_reads_infinite_ends_it_too(tmp_path):
    class Two(Rig):
        def read(self, time):
            return [0.0, math.inf if self.put[3:] else 1e5]

    pressure = ChannelMap("pressure", "p", "Pa", "Pa", recorded_unit="Pa")
    wiring = replace(WIRING, measured=(*WIRING.measured, pressure))
    log = Log(tmp_path / "log.csv", Layout(wiring).columns)
    end = Guard(Two(), Loop(lambda n: 1.0), FastClock(1e-3), wiring, SETTINGS, log).run(9)
    log.close()
    assert (end.how, end.why, end.safe) == (How.FAILED, "pressure reads inf", True)


def test_a_driver_that_reads_too_much_is_told(guarded):
    class Two(Rig):
        def read(self, time):
            return [0.0, 0.0]

    end, _ = guarded(Two(), lambda n: 1.0)
    assert "2 values; expected position" in end.why


class Coarse(Rig):
    """A driver that rounds to whole volts."""

    resolution = 1.0

    def write(self, command, time):
        return float(round(super().write(command, time)))


@pytest.mark.parametrize(("resolution", "accepted"), [(1.0, [SAFE] + [1.3] * 5), (0.0, [0.0] + [1.0] * 5)])
def test_what_stands_is_logged_and_rounding_is_no_interference(tmp_path, resolution, accepted):
    rig, loop, seen = Coarse(), Loop(lambda n: 1.3), []
    rig.resolution = resolution
    loop.send = seen.append
    log = Log(tmp_path / "log.csv", Layout(WIRING).columns)
    Guard(rig, loop, FastClock(1e-3), WIRING, SETTINGS, log).run(6)
    log.close()
    assert [sample.accepted for sample in seen] == pytest.approx(accepted)
    assert [sample.standing for sample in seen] == [0.0] + [1.0] * 5
    assert pd.read_csv(tmp_path / "log.csv")["u"].tolist() == [1.0] * 6


# The safe command, until it is put.


class Plc:
    """A rig whose connections break at the seventh write and which lets nobody in for so many tries."""

    def __init__(self, away):
        self.away, self.put, self.opened, self.closed = away, [], 0, 0

    def open(self):
        self.away -= 1
        if self.away >= 0:
            raise ConnectionRefusedError("away")
        self.opened += 1
        return PlcLink(self)


class PlcLink(Rig):
    def __init__(self, plc):
        super().__init__()
        self.plc, self.broken = plc, False

    def write(self, command, time):
        self.broken = self.broken or (len(self.plc.put) == 6 and self.plc.opened == 1)
        if self.broken:
            raise ConnectionResetError("away")
        self.plc.put.append(command)
        return command

    def close(self):
        self.plc.closed += 1


@pytest.mark.parametrize(("away", "seconds", "safe"), [(0, 5.0, True), (4, 5.0, True), (10**6, 0.1, False)])
def test_the_safe_command_is_tried_through_fresh_connections_as_long_as_the_time_allows(
    tmp_path, away, seconds, safe
):
    plc, said = Plc(0), []
    first = plc.open()
    plc.away = away
    log = Log(tmp_path / "log.csv", Layout(WIRING).columns)
    failsafe = Failsafe(seconds, plc.open, lambda: said.append(1))
    guard = Guard(first, Loop(lambda n: 1.0), FastClock(1e-3), WIRING, SETTINGS, log, failsafe)
    end = guard.run(20)
    log.close()
    assert (end.how, end.safe, said, plc.closed) == (How.FAILED, safe, [1], 1)
    assert (plc.put[-1] == SAFE, end.safe_after is not None) == (safe, safe)
    assert (guard.driver is None) is not safe


def test_tries_come_ever_more_rarely(monkeypatch):
    waits = []
    monkeypatch.setattr("optid.live.failsafe.time", Stopwatch(waits))
    assert Failsafe(10.0, Plc(10**6).open).put(None, lambda driver: None).seconds is None
    assert waits[:3] == pytest.approx([0.01, 0.02, 0.04])
    assert max(waits) == 0.5
    assert sum(waits) == pytest.approx(10.0)


class Stopwatch:
    def __init__(self, waits):
        self.waits, self.now = waits, 0.0

    def monotonic(self):
        return self.now

    def sleep(self, seconds):
        self.waits.append(seconds)
        self.now += seconds


# Speed, travel, and the end of the stroke.


@pytest.mark.parametrize(
    ("limits", "ahead", "sample"),
    [
        ({"speed": 0.05}, 0.0, 110),  # half of the speed's base after the axis began to move
        ({"travel": 0.02}, 0.0, 300),
        ({}, 0.05, 750),  # 50 ms before the end
        ({}, 0.0, None),
    ],
)
def test_a_fence_lets_only_what_leads_back_through(limits, ahead, sample):
    fence, held = MotionLimiter(replace(SETTINGS, limits=replace(LIMITS, **limits), ahead=ahead)), None
    for n in range(790):  # 0.1 m/s from 0.1 s on: at the end of the stroke, 0.1 m, after 0.8 s
        y = math.nan if n == 50 else 0.03 + 1e-4 * max(n - 100, 0)
        if fence.held(1e-3 * n, y, 3.0) == SAFE and held is None:
            held = n
            assert fence.held(1e-3 * n, y, -3.0) == -3.0
    assert held == (None if sample is None else pytest.approx(sample, abs=2))


def test_a_driver_that_takes_nothing_is_said(guarded):
    class Dead(Rig):
        def write(self, command, time):
            if self.reads:
                raise OSError("dead")
            return command

    end, _ = guarded(Dead(), lambda n: 1.0)
    assert not end.safe
    assert "the safe command could not be written" in end.why


def test_one_silent_sample_gets_the_safe_command_and_the_session_goes_on(guarded):
    end, log = guarded(Rig(), lambda n: None if n == 7 else 1.0)
    assert (end.how, end.missed) == (How.DONE, 1)
    assert log["u"][7] == SAFE
    assert log["u"][8] == 1.0


def test_samples_that_were_not_taken_are_rows_without_a_measurement(guarded):
    end, log = guarded(Rig(), lambda n: 1.0, clock=LateClock(1e-3))
    assert end.missed == 2
    assert log["t"].tolist() == pytest.approx([1e-3 * n for n in range(20)])
    assert log["x"].isna().tolist() == [n in (3, 4) for n in range(20)]
    assert log["u"].notna().all()


@pytest.mark.parametrize(("column", "rows"), [("t", 19), ("", 20)])
def test_times_in_the_log_increase_however_late_a_sample_is(tmp_path, column, rows):
    class VeryLate(LateClock):
        def wait(self, sample):
            return super().wait(sample) + (1.4e-3 if sample == 2 else 0.0)  # after sample 3 was due

    wiring = replace(WIRING, time=replace(WIRING.time, column=column))
    log = Log(tmp_path / "log.csv", Layout(wiring).columns)
    end = Guard(Rig(), Loop(lambda n: 1.0), VeryLate(1e-3), wiring, SETTINGS, log).run(20)
    log.close()
    frame = pd.read_csv(tmp_path / "log.csv")
    assert (len(frame), end.missed) == (rows, 2)
    assert column == "" or frame["t"].is_monotonic_increasing


def test_wild_wishes_do_not_reach_the_rig(guarded):
    wild = [1e9, -1e9, math.nan, math.inf, -math.inf, 3.0]
    rig = Rig()
    end, _ = guarded(rig, lambda n: wild[n % len(wild)])
    assert all(-5.0 <= u <= 5.0 for u in rig.put)
    assert end.held_back > 0


number = st.floats(allow_nan=True, allow_infinity=True)


@given(wish=number, before=st.floats(-5, 5), position=number, span=st.floats(1e-5, 1e-2))
def test_limits_hold_for_every_wish(wish, before, position, span):
    u = LIMITS.allowed(wish, before, position, span)
    assert -5.0 <= u <= 5.0
    assert u == SAFE or abs(u - before) <= 1000.0 * span * (1 + 1e-9)
    if not math.isfinite(wish) or not math.isfinite(position):
        assert u == SAFE
    elif position >= 0.1:
        assert u <= max(SAFE, before - 0.0)
    elif position <= -0.1:
        assert u >= min(SAFE, before)


@given(st.floats(-5, 5))
def test_a_command_goes_to_its_column_and_back(u):
    wiring = replace(WIRING, command=replace(WIRING.command, factor=1e-3 / 5, shift=0.1))
    assert wiring.taken(wiring.put(u)) == pytest.approx(u, abs=1e-12)
