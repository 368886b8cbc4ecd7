"""The small parts of a session: log, ring, durations, messages, reference, gains, settings, slices."""

import errno
import json
import math
import os
import tracemalloc
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from optid.core.readers import read_recording
from optid.errors import InputError, RigError
from optid.live.excerpt import BLOCK, HELD_OUT, SEEN, UNSEEN, last_rows, offer_diagnosis
from optid.live.gains import controller_settings, gentle, read_gains
from optid.live.latency_histogram import LatencyHistogram
from optid.live.log import LOG, Layout, Log
from optid.live.messages import Reply, Sample, pack_reply, pack_sample, unpack_reply, unpack_sample
from optid.live.reference import read_profile, read_reference, tour
from optid.live.results import fit_percent, last_stretch
from optid.live.ring_buffer import RingBuffer
from optid.live.settings import Limits, live_settings, wiring_of
from optid.pid.controller import Gains
from optid.rigs.rigfile import read_rig

number = st.floats(allow_nan=False)


@given(st.integers(0, 2**62), number, number, st.lists(number, max_size=5), st.tuples(*[number] * 6))
def test_messages_arrive_as_they_were(count, time, standing, values, rest):
    sample, reply = Sample(count, time, standing, -standing, tuple(values)), Reply(count, *rest)
    assert unpack_sample(pack_sample(sample)) == sample
    assert unpack_reply(pack_reply(reply)) == reply


@given(st.lists(st.tuples(st.integers(1, 9), st.booleans()), max_size=30))
def test_a_ring_gives_each_row_once_as_long_as_it_is_there(bursts):
    ring = RingBuffer(7, 2)
    reader = RingBuffer(7, 2, ring.name)
    try:
        written, seen, got = 0, 0, []
        for burst, look in bursts:
            for _ in range(burst):
                ring.add((float(written), -float(written)))
                written += 1
            if look:
                seen, rows = reader.since(seen)
                assert seen == written
                got.extend(rows[:, 0].tolist())
                assert len(rows) == 0 or rows[-1, 0] == written - 1
        assert got == sorted(set(got))
    finally:
        reader.close()
        ring.close()


def test_durations_are_counted_in_classes_of_a_few_percent():
    rng, durations = np.random.default_rng(0), LatencyHistogram()
    values = rng.lognormal(math.log(1e-4), 1.0, 20_000)
    for value in values:
        durations.add(value)
    for percent in (50, 99, 99.9):
        assert durations.percentile(percent) == pytest.approx(np.percentile(values, percent), rel=0.07)
    summary = durations.summary()
    assert summary["number"] == 20_000
    assert summary["max_us"] == pytest.approx(1e6 * values.max(), abs=0.01)
    assert summary["mean_us"] == pytest.approx(1e6 * values.mean(), rel=1e-3)
    for strange in (0.0, 1e-12, 1e9):
        durations.add(strange)
    assert LatencyHistogram().summary() is None


def test_a_log_holds_each_row_as_soon_as_it_is_written(tmp_path):
    log = Log(tmp_path / "log.csv", ["t", "u", "x"])
    log.row((0.001, math.nan, -1.5))
    assert (tmp_path / "log.csv").read_text() == "t,u,x\n0.001,,-1.5\n"
    log.row((3600.123456, math.inf, 1e-300))
    log.close()
    frame = pd.read_csv(tmp_path / "log.csv")
    assert frame["t"].tolist() == [0.001, 3600.123456]
    assert frame["u"].isna().all()
    with pytest.raises(FileExistsError):
        Log(tmp_path / "log.csv", ["t"])


def test_a_full_disk_never_cuts_a_row(tmp_path, monkeypatch):
    log, real, left = Log(tmp_path / "log.csv", ["t", "u"]), os.write, [25]

    def write(file, data):  # a disk with room for so many bytes, of which it takes three at a time
        if not left[0]:
            raise OSError(errno.ENOSPC, "no space left on device")
        taken = real(file, data[: min(3, left[0])])
        left[0] -= taken
        return taken

    with monkeypatch.context() as patched:
        patched.setattr(os, "write", write)
        log.row((1.0, 2.0))
        log.row((1.25, 2.25))
        log.row((1.5, 2.5))
        with pytest.raises(OSError, match="no space"):
            log.row((1.75, 2.75))
    log.row((2.0, 3.0))  # somebody made room
    log.close()
    assert (tmp_path / "log.csv").read_text() == "t,u\n1,2\n1.25,2.25\n1.5,2.5\n2,3\n"


def test_column_names_are_quoted(tmp_path):
    names = ["t", "u, command", 'the "x"', "a;b", "plain name (mm)"]
    Log(tmp_path / "log.csv", names).close()
    assert pd.read_csv(tmp_path / "log.csv").columns.tolist() == names
    assert (tmp_path / "log.csv").read_text().endswith('"a;b",plain name (mm)\n')


def with_table(rig, tmp_path, change):
    path = tmp_path / "rig.toml"
    path.write_text(change(rig.source), encoding="utf-8")
    return read_rig(path)


def test_a_log_is_read_in_the_rigs_own_units(bench, tmp_path):
    def change(source):
        source = source.replace(
            'time = { column = "t", unit = "s" }', 'time = { column = "ms", unit = "ms" }'
        )
        source = source.replace('reference = { column = "r", unit = "mm" }', "")
        return source.replace('"x", unit = "mm" }', '"x", unit = "cm", offset = "13 cm" }')

    rig = with_table(bench, tmp_path, change)
    layout = Layout(wiring_of(rig))
    assert layout.columns == ["ms", "u", "x", "reference", "x_predicted", "x_simulated", "x_windowed"]
    log = Log(tmp_path / "log.csv", layout.columns)
    for n in range(3):
        reply = Reply(n, 1.0, 0.02, 0.03, 0.04, 0.05, 1e-5)
        log.row(layout.row(1e-3 * n, 2.5, (12.0,), reply))
    log.close()
    record = read_recording(tmp_path / "log.csv", rig)
    assert record.time.tolist() == pytest.approx([0.0, 1e-3, 2e-3])
    assert record["position"].values.tolist() == pytest.approx([-0.01] * 3)
    assert record["command"].recorded.tolist() == pytest.approx([2.5] * 3)
    row = pd.read_csv(tmp_path / "log.csv").iloc[0]
    assert [row["reference"], row["x_windowed"]] == pytest.approx([15.0, 18.0])


def test_a_column_of_the_rigs_that_has_a_name_of_ours_keeps_it(bench, tmp_path):
    own = 'reference = { column = "r", unit = "mm" }'
    rig = with_table(bench, tmp_path, lambda s: s.replace(own, "").replace('"x", unit', '"reference", unit'))
    assert Layout(wiring_of(rig)).columns[2:4] == ["reference", "reference_live"]


@pytest.mark.parametrize(
    ("text", "at", "expected"),
    [
        ("sine 20 mm 0.5 Hz", 0.5, 0.02),
        ("sine 20 mm 0.5 Hz", 0.25, 0.02 * 0.5**0.5),
        ("sine 20 mm 0.5 Hz 10 mm", 3.5, -0.01),
        ("square 20 mm 1 Hz", 0.49, 0.02),
        ("square 20 mm 1 Hz", 1.51, -0.02),
        ("triangle 20 mm 1 Hz", 0.125, 0.01),
        ("triangle 20 mm 1 Hz", 0.75, -0.02),
    ],
)
def test_periodic_references(bench, text, at, expected):
    reference = read_profile(text, live_settings(bench).limits, "m")
    assert reference.at(at) == pytest.approx(expected, abs=2e-6)
    assert replace(reference, start=100.3).at(100.3 + at) == pytest.approx(expected, abs=2e-6)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("sinus 20 mm 1 Hz", 'did you mean "sine"'),
        ("sine 20 mm", "sine 20 mm 0.5 Hz"),
        ("sine 200 mm 1 Hz", "beyond the stroke limits"),
        ("sine 20 mm 1 mm", "sine"),
        ("sine 20 mm 1e-9 Hz", "0.001 to 1000 Hz"),
        ("data/bench.csv", "does not start with a number"),  # what a page asks for opens no file
        (", ".join(f"{n}:1 mm" for n in range(1001)), "at most 1000"),
    ],
)
def test_profiles_that_are_none(bench, text, words):
    with pytest.raises(InputError, match=words):
        read_profile(text, live_settings(bench).limits, "m")


def test_references(bench):
    limits = live_settings(bench).limits
    stairs = read_reference("0:0 mm, 2:60 mm, 2.5:-4 cm", bench, limits, "m")
    assert [stairs.at(t) for t in (0.0, 1.999, 2.0, 2.6, 99.0)] == [0.0, 0.0, 0.06, -0.04, -0.04]
    assert read_reference("60 mm", bench, limits, "m").at(5.0) == 0.06
    recorded = read_reference(str(bench.path.with_name("bench.csv")), bench, limits, "m")
    assert recorded.at(0.0) == pytest.approx(-0.06295)
    around = tour(limits)
    assert around.at(0.0) == around.at(around.period) == around.at(7 * around.period)
    assert max(around.values) < limits.stroke[1]
    for wrong in ("1:0 mm", "0:0 mm, 0:1 mm", "x:1 mm", "60 s", "500 mm", ""):
        with pytest.raises(InputError, match="--reference"):
            read_reference(wrong, bench, limits, "m")
    with pytest.raises(InputError, match="no tour"):
        tour(Limits(-1.0, 1.0, 1.0, 0.0))


def test_gains(bench):
    settings = live_settings(bench)
    assert read_gains("kp=40, ki=60 kd=0.5", settings) == (Gains(40.0, 60.0, 0.5), None)
    for wrong in ("kp", "kp=a", "kp=1 kq=2", "ki=3", "", "kp=inf", "nothing.json"):
        with pytest.raises(InputError):
            read_gains(wrong, settings)
    assert gentle(Limits(-5.0, 5.0, 1.0, 0.0, (-0.1, 0.15))) == Gains(20.0)
    with pytest.raises(InputError, match="no stroke"):
        gentle(Limits(-5.0, 5.0, 1.0, 0.0))


def test_a_tuned_controller_comes_whole_within_the_sessions_limits(bench, tmp_path):
    settings, file = live_settings(bench), tmp_path / "pid.json"
    document = {
        "schema": "optid.pid/1",
        "gains": {"kp": 3.0, "setpoint_weight": 0.5},
        "sample_time": 1e-3,
        "limits": {"low": -4.0, "high": 9.0, "rate": None, "resolution": 0.01},
    }
    file.write_text(json.dumps(document))
    gains, own = read_gains(str(file), settings)
    assert gains == Gains(3.0, setpoint_weight=0.5)
    ours = controller_settings(settings, own)
    assert (ours.low, ours.high, ours.rate, ours.resolution) == (-4.0, 5.0, 500.0, 0.01)
    file.write_text(json.dumps({**document, "sample_time": 4e-3}))
    with pytest.raises(InputError, match=r"0\.004 s; expected 0\.001 s"):
        read_gains(str(file), settings)


def test_settings_come_from_the_live_table(bench, tmp_path):
    table = """
[live]
rate = "500 Hz"
command_limits = ["-2 V", "3 V"]
command_rate = "100 V/s"
safe_command = "0.1 V"
stroke_limits = ["-50 mm", "40 mm"]
watchdog = "20 ms"
safe_time = "3 s"
speed_limit = "400 mm/s"
travel_limit = "30 mm"
"""
    settings = live_settings(with_table(bench, tmp_path, lambda source: source + table))
    assert (settings.rate, settings.watchdog, settings.safe_time) == (500.0, 0.02, 3.0)
    assert settings.limits == Limits(-2.0, 3.0, 100.0, 0.1, (-0.05, 0.04), 0.4, 0.03)


def test_the_watchdog_of_a_simulated_rig_waits_long_unless_the_table_says_how_long(bench, tmp_path):
    assert live_settings(bench).watchdog == 0.05
    assert live_settings(bench, relaxed=True).watchdog == 10.0
    own = with_table(bench, tmp_path, lambda source: source + '\n[live]\nwatchdog = "20 ms"\n')
    assert live_settings(own, relaxed=True).watchdog == 0.02


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('rate = "0 Hz"', "positive"),
        ('rat = "100 Hz"', 'did you mean "rate"'),
        ('command_limits = ["2 V", "-2 V"]', "not below"),
        ('command_limits = ["2 mm", "3 mm"]', "command_limits"),
        ('safe_command = "9 V"', "outside the command limits"),
        ('command_rate = "0 V/s"', "positive rate"),
        ('stroke_limits = "5 mm"', "stroke_limits"),
        ('watchdog = "-1 s"', "watchdog"),
        ('safe_time = "0 s"', "safe_time"),
        ('speed_limit = "1 mm"', "speed_limit"),
        ('travel_limit = "0 mm"', "positive limit"),
    ],
)
def test_a_wrong_live_table_is_refused_by_field(bench, tmp_path, line, words):
    rig = with_table(bench, tmp_path, lambda source: f"{source}\n[live]\n{line}\n")
    with pytest.raises(RigError, match=words):
        live_settings(rig)


def test_recordings_without_a_time_column_keep_their_rate(bench, tmp_path):
    rig = with_table(
        bench, tmp_path, lambda s: s.replace('time = { column = "t", unit = "s" }', 'rate = "250 Hz"')
    )
    assert live_settings(rig).rate == 250.0
    with pytest.raises(RigError, match="250 Hz"):
        live_settings(rig, 1000.0)


def test_the_last_minutes_are_two_recordings(bench, tmp_path, run_live, monkeypatch):
    _, _, path = run_live(bench, seconds=1.5)
    path.rename(tmp_path / LOG)
    words = offer_diagnosis(bench.path, tmp_path, 1000.0)
    assert words.startswith("optid diagnose ") and str(tmp_path / SEEN) in words
    monkeypatch.chdir(tmp_path)
    assert f" {SEEN} --holdout {UNSEEN} --out diagnosis" in offer_diagnosis(bench.path, tmp_path, 1000.0)
    seen, unseen = (read_recording(tmp_path / name, bench) for name in (SEEN, UNSEEN))
    assert len(unseen) == round(HELD_OUT * 1500)
    assert len(seen) + len(unseen) == 1500
    assert unseen.time[0] > seen.time[-1]


def test_a_session_is_shown_by_its_last_step(bench, run_live):
    _, _, path = run_live(bench, seconds=5.0)
    lines = path.read_text().splitlines()
    cells = lines[4500].split(",")
    lines[4500] = ",".join([*cells[:2], *[""] * (len(cells) - 2)])  # a sample that was not taken
    path.write_text("\n".join(lines) + "\n")
    settings, wiring = live_settings(bench), wiring_of(bench)
    minute = last_stretch(path, wiring, settings)
    assert minute.last_step == pytest.approx(4.0)
    part = minute.around(minute.last_step)
    assert (part.time[0], part.time[-1]) == pytest.approx((3.9, 4.999))
    assert part.positions["reference"][0] == pytest.approx(0.0585)
    assert np.nanmax(np.abs(part.positions["real"] - part.positions["predicted"])) < 1e-3
    assert minute.limits == (-5.0, 5.0)
    fits = fit_percent(path, wiring)
    frame = pd.read_csv(path)
    for kind, fit in fits.items():
        known = frame.dropna(subset=["x", f"x_{kind}"])
        error, about = known["x"] - known[f"x_{kind}"], known["x"] - known["x"].mean()
        assert fit == pytest.approx(100 * (1 - math.sqrt((error**2).sum() / (about**2).sum())), abs=1e-6)


def test_only_the_end_of_a_long_log_is_read(tmp_path):
    rows = [f"{n},{n % 7}" for n in range(20_000)]
    (tmp_path / "log.csv").write_text("t,x\n" + "\n".join(rows) + "\n19999.5,")  # one row is being written
    head, last = last_rows(tmp_path / "log.csv", 10)
    assert (head, [row.decode() for row in last]) == (b"t,x", rows[-10:])
    assert (tmp_path / "log.csv").stat().st_size > 2 * BLOCK
    for count in (15_000, 50_000):
        head, last = last_rows(tmp_path / "log.csv", count)
        assert [row.decode() for row in last] == rows[-count:]


def test_the_last_minutes_are_written_in_little_memory(tmp_path):
    (tmp_path / LOG).write_text("t,x\n" + "".join(f"{n},{n % 7}\n" for n in range(200_000)) + "200000,")
    tracemalloc.start()
    try:
        words = offer_diagnosis(tmp_path / "rig.toml", tmp_path, 1000.0)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert words.startswith("optid diagnose")
    assert peak < 8 * BLOCK
    seen, unseen = ((tmp_path / name).read_text().splitlines() for name in (SEEN, UNSEEN))
    assert (seen[1], seen[-1], unseen[1], unseen[-1]) == ("80000,4", "159999,0", "160000,1", "199999,2")
    assert seen[0] == unseen[0] == "t,x"


@pytest.mark.full
def test_a_session_holds_no_more_after_a_long_time_than_after_a_short_one(bench, run_live):
    held = {}
    reference = tour(live_settings(bench).limits)

    class Looking:
        """A demanded position that notes how much memory is held when it is asked for."""

        period = reference.period

        def at(self, time):
            if round(1e3 * time) in (2000, 4000, 12_000):
                held[round(time)] = tracemalloc.get_traced_memory()[0]
            return reference.at(time)

    tracemalloc.start()
    try:
        run_live(bench, seconds=12.01, reference=Looking())
    finally:
        tracemalloc.stop()
    assert held[12] - held[4] < 4096  # bytes, over 8000 samples
