"""What ruins a fit is seen: jumps, outliers, the wrong sign, feedback alone, tied inputs, missing commands."""

from dataclasses import replace

import numpy as np
import pytest

from optid.core.recording import Channel, Recording
from optid.core.sheet import build
from optid.quality.faults import jumps, outliers
from optid.quality.feedback import feedback, single_line, tied
from optid.quality.motion import Lag, polarity, still
from optid.quality.quality import quality
from optid.quality.verdict import verdict
from optid.rigs.servo_pneumatic import servo_pneumatic
from tests.quality.test_quality import DT, MODEL, N, kinds, recording, signals


def pair(u, y, reference=None, held=True):
    time = np.arange(len(u)) * 0.01
    channels = {
        "command": Channel("command", "u", "V", u, held=held),
        "position": Channel("position", "x", "m", y),
    }
    if reference is not None:
        channels["reference"] = Channel("reference", "r", "m", reference)
    return Recording("pair.csv", time, channels)


def test_a_jump_that_stays_is_an_error_of_a_position():
    s = signals()
    s["position"][5000:] += 0.2
    (remark,) = jumps(recording(**s), ("position",), ("position",))
    assert (remark.kind, remark.severity) == ("jump", "error")
    assert remark.interval == pytest.approx((4.999, 5.0))
    assert list(jumps(recording(), ("position", "pressure_a"), ("position",))) == []


def test_single_samples_off_their_neighbours_are_outliers_and_no_jumps():
    s = signals()
    s["position"][[100, 2000, 7000]] += [0.01, -0.02, 0.015]
    (remark,) = outliers(recording(**s), ("position",))
    assert "3 samples" in remark.message
    assert list(jumps(recording(**s), ("position",), ("position",))) == []


def test_small_jumps_show_against_the_motion_around_them_and_an_impact_does_not():
    s = signals()
    fastest = float(np.abs(np.diff(s["position"])).max())
    lost = s["position"] + 6 * fastest * (np.arange(N) // 1000)
    (remark,) = jumps(recording(position=lost), ("position",), ("position",))
    assert "7 such steps" in remark.message
    struck = np.abs(0.2 * (np.arange(N) * DT - 3.0))  # turns at full speed within a sample
    assert list(jumps(recording(position=struck), ("position",), ("position",))) == []


def test_a_sign_that_changes_within_the_record_is_an_error():
    s = signals()
    half = np.arange(N) > N // 2
    found = quality(recording(**{**s, "command": np.where(half, -s["command"], s["command"])}), MODEL)
    assert any(r.kind == "polarity" and "one half of the record" in r.message for r in found)


@pytest.mark.parametrize("seed", range(3))
def test_the_other_sign_is_an_error(seed):
    s = signals(seed)
    found = quality(recording(**{**s, "command": -s["command"]}), MODEL)
    assert ("polarity", "position") in kinds(found)
    assert found[0].severity == "error"


def closed(seed=0, excited=False):
    """A regulator: u = -0.4 y of the sample before, a plant y = 0.9 y + 0.1 u + e."""
    rng = np.random.default_rng(seed)
    u, y, r = np.zeros(4000), np.zeros(4000), np.zeros(4000)
    if excited:
        r = np.sign(np.sin(0.05 * np.arange(4000)))
    for k in range(1, 4000):
        u[k] = 0.4 * (r[k] - y[k - 1])
        y[k] = 0.9 * y[k - 1] + 0.1 * u[k - 1] + 0.01 * rng.normal()
    return u, y, r


def test_feedback_that_nothing_excites_is_told():
    u, y, r = closed()
    (remark,) = feedback(pair(u, y), ("command",), ("position",))
    assert remark.kind == "feedback"
    assert len(list(feedback(pair(u, y, r), ("command",), ("position",)))) == 1
    u, y, r = closed(excited=True)
    assert list(feedback(pair(u, y, r), ("command",), ("position",))) == []
    assert list(feedback(pair(u, y), ("command",), ("position",))) == []
    assert list(feedback(recording(), ("command",), ("position",))) == []


def test_one_sine_and_tied_inputs():
    t = np.arange(4000) * 0.01
    sine, noise = np.sin(2 * np.pi * t), np.random.default_rng(0).normal(size=4000)
    (remark,) = single_line(pair(sine, noise), ("command",))
    assert "1 Hz" in remark.message
    two = pair(sine + np.sin(9 * t), noise)
    assert list(single_line(two, ("command",))) == []
    (remark,) = tied(pair(sine, 2 * sine + 1), ("command", "position"))
    assert remark.kind == "tied"
    assert list(tied(two, ("command", "position"))) == []


def test_free_motion_without_a_command_can_be_used_and_a_fast_resonance_is_no_noise():
    swing = 0.1 * np.sin(np.arange(4000) * 2 * np.pi / 9)
    (remark,) = still(pair(np.zeros(4000), swing), ("command",), ("position",))
    assert (remark.severity, remark.channel) == ("warning", "command")
    noise = 3e-5 * np.random.default_rng(0).normal(size=4000)
    found = list(still(pair(np.sin(np.arange(4000.0)), noise), ("command",), ("position",)))
    assert [(r.severity, r.channel) for r in found] == [("error", "position")]


def test_a_command_that_is_missing_for_long_cuts_the_record():
    s = signals()
    whole = recording(**s)
    command = replace(whole["command"], held=True)
    gone = np.array(command.values)
    gone[2000:6000] = np.nan
    cut = replace(whole, channels={**whole.channels, "command": replace(command, values=gone)})
    assert [len(part) for part in cut.segments()] == [2000, 2000]
    (remark,) = (r for r in quality(cut, MODEL) if r.channel == "command")
    assert "nothing is simulated there" in remark.message
    gone[40:] = np.nan
    cut = replace(whole, channels={**whole.channels, "command": replace(command, values=gone)})
    found = quality(cut, MODEL)
    assert "only 40 of 8000 samples" in found[0].message
    assert found[0].severity == "error"
    assert len(whole) == N
    assert whole.interval == DT


def test_the_verdict_says_what_for_and_what_next():
    s = signals()
    sound = recording(**s)
    good = verdict([(sound, quality(sound, MODEL))], [], ["mass"], "rig.toml run.csv")
    assert good.fit_for == ("simulate", "identify", "fit", "diagnose")
    assert good.next == "optid fit rig.toml run.csv --out DIR"
    wrong = recording(**{**s, "command": -s["command"]})
    bad = verdict([(wrong, quality(wrong, MODEL))], [], ["mass"], "rig.toml run.csv")
    assert "fit" not in bad.fit_for
    assert "sign" in bad.next
    assert "not for fit" in bad.sentence
    idle = verdict([(sound, ())], ["mass"], ["mass"], "rig.toml run.csv")
    assert "take mass out of [fit]" in idle.next
    assert build(servo_pneumatic).outputs


def test_a_value_that_follows_the_model_rules_out_a_wrong_sign_that_its_acceleration_suggests():
    """An oscillating pressure: its acceleration opposes the command more than its value follows it."""
    opposes = Lag(0.02, 0.62, 0.62, 0.3, 0.05, rising=0.2, falling=0.62, sign=-1)
    follows = Lag(0.05, 0.38, 0.38, 0.32, 0.05, rising=0.38, falling=0.1, sign=1)
    by_chance = replace(follows, chance=0.4)

    def remarks(value):
        seen = (("acceleration of position", opposes), ("position", value))
        signs = {("command", "position"): 1}
        return list(polarity(recording(), signs, ("command",), ("position",), lambda *_: seen))

    assert remarks(follows) == []
    assert len(remarks(by_chance)) == 1
