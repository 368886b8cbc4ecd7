"""Each remark appears on a recording with that fault, and a sound recording draws none."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from optid.core.model import CLOCK, INTERVAL
from optid.core.readers import read_recording
from optid.core.recording import Channel, ChannelMap, Recording
from optid.core.sheet import build
from optid.errors import RecordingError
from optid.quality.motion import lag
from optid.quality.quality import quality
from optid.quality.response import signs
from optid.rigs.cascaded_tanks import cascaded_tanks
from optid.rigs.rigfile import read_rig
from optid.rigs.servo_pneumatic import servo_pneumatic
from tests.effects.plants import grown

DATA = Path(__file__).parents[2] / "data"
N, DT = 8000, 1e-3
MODEL = build(servo_pneumatic)
NOISE = {"position": 3e-5, "pressure_a": 500.0}


def signals(seed=0):
    """An axis in the crudest form: the speed follows the command by a lag of 15 ms, the pressure by 5 ms."""
    rng = np.random.default_rng(seed)
    command = np.convolve(rng.normal(size=N + 200), np.hanning(200), "valid")[:N]
    command = 0.8 * command / np.abs(command).max()
    speed, pressure = np.zeros(N), np.zeros(N)
    for k in range(1, N):
        speed[k] = speed[k - 1] + DT / 0.015 * (command[k - 1] - speed[k - 1])
        pressure[k] = pressure[k - 1] + DT / 0.005 * (command[k - 1] - pressure[k - 1])
    position = np.cumsum(speed) * DT
    return {
        "command": command,
        "position": position - np.mean(position) + rng.normal(0, NOISE["position"], N),
        "pressure_a": 4e5 + 1e5 * pressure + rng.normal(0, NOISE["pressure_a"], N),
    }


def recording(time=None, **changed):
    values = {**signals(), **changed}
    time = np.arange(N) * DT if time is None else time
    units = {"command": "1", "position": "m", "pressure_a": "Pa"}
    channels = {
        role: Channel(role, role, units[role], v, full_scale=1.0 if role == "command" else None)
        for role, v in values.items()
    }
    return Recording("test.csv", time, channels)


def kinds(found):
    return {(remark.kind, remark.channel) for remark in found}


def only(found, kind, channel):
    """The remark of this kind on this channel, and nothing else is found."""
    assert kinds(found) == {(kind, channel)}
    return found[0]


@pytest.mark.parametrize("seed", range(10))
def test_sound_recordings_draw_no_remark(seed):
    assert quality(recording(**signals(seed)), MODEL) == ()


@pytest.mark.parametrize("samples", [2, 3, 5, 60])
def test_a_recording_of_few_samples_is_looked_at_like_any_other(samples):
    whole = recording()
    channels = {
        role: replace(channel, values=channel.values[:samples]) for role, channel in whole.channels.items()
    }
    found = quality(Recording("short.csv", whole.time[:samples], channels), MODEL)
    assert all(remark.message for remark in found)


def test_what_effects_read_that_no_channel_holds_is_not_asked_of_a_recording():
    """Time since the start, the interval, past commands: the recording's own, and remarked on once."""
    model = grown("servo-pneumatic").model
    assert {(CLOCK, 0), (INTERVAL, 0), ("command", 1)} <= {(port.role, port.ago) for port in model.inputs}
    flat = recording(command=np.zeros(N))
    assert quality(flat, model) == quality(flat, MODEL) != ()


@pytest.mark.parametrize("case", ["plain", "one_effect", "two_effects_with_pressures"])
def test_example_rigs_draw_no_warning(case, shared):
    rig = read_rig(shared / "examples" / case / "rig.toml")
    for name in ("steps", "multisine", "ramps", "mixed"):
        found = quality(read_recording(shared / "examples" / case / f"{name}.csv", rig), rig.model)
        assert kinds(found) <= {("saturated", "command")}


def test_saturated_level_of_the_tanks_is_seen(shared):
    model = build(cascaded_tanks)
    (pump,), (level,) = model.inputs, model.outputs

    class Maps:
        channels = {  # noqa: RUF012
            "time": ChannelMap("time", "", "s", "s", rate=0.25),
            pump.role: ChannelMap(pump.role, "uEst", "V", "V"),
            level.role: ChannelMap(level.role, "yEst", "V", "V"),
        }

    found = quality(read_recording(shared / "recordings/cascaded_tanks/dataBenchmark.csv", Maps()), model)
    remark = only(found, "clipped", level.role)
    assert "highest value 10 V" in remark.message


def test_gaps_short_and_long():
    time = np.arange(N) * DT
    time[4000:] += 0.005
    remark = only(quality(recording(time), MODEL), "gap", "time")
    assert remark.severity == "note"
    time[6000:] += 0.5
    remark = only(quality(recording(time), MODEL), "gap", "time")
    assert remark.severity == "warning"
    assert "2 gaps" in remark.message
    np.testing.assert_allclose(remark.interval, (6.004, 6.505))


def test_jitter_counts_where_it_exceeds_the_noise():
    rng = np.random.default_rng(1)
    time = np.arange(N) * DT
    assert quality(recording(time + rng.normal(0, 1e-6, N)), MODEL) == ()
    found = quality(recording(time + rng.uniform(-3e-4, 3e-4, N)), MODEL)
    assert ("jitter", "position") in kinds(found)


def test_slow_sampling():
    values = {role: v[::160] for role, v in signals().items()}
    found = quality(recording(np.arange(N)[::160] * DT, **values), MODEL)
    assert ("slow", "pressure_a") in kinds(found)


def test_missing_samples():
    s = signals()
    s["position"][100:103] = np.nan
    assert only(quality(recording(**s), MODEL), "missing", "position").severity == "note"
    s["position"][2000:2600] = np.nan
    remark = only(quality(recording(**s), MODEL), "missing", "position")
    assert (remark.severity, remark.interval) == ("warning", (2.0, 2.6))
    s["position"][:] = np.nan
    assert only(quality(recording(**s), MODEL), "missing", "position").severity == "warning"
    s = signals()
    s["command"][50] = np.nan
    assert "held" in only(quality(recording(**s), MODEL), "missing", "command").message


def test_saturation_is_a_note_and_beyond_scale_a_warning():
    s = signals()
    clipped = np.clip(1.6 * s["command"], -1, 1)
    found = {r.kind: r for r in quality(recording(command=clipped), MODEL)}
    assert found.keys() == {"saturated"}
    assert found["saturated"].severity == "note"
    assert f"{100 * np.mean(np.abs(clipped) == 1):.2f} %" in found["saturated"].message
    assert only(quality(recording(command=1.6 * s["command"]), MODEL), "beyond_scale", "command")


@pytest.mark.parametrize(("step", "severity"), [(2e-4, "note"), (2e-2, "warning")])
def test_coarse_grid(step, severity):
    s = signals()
    found = quality(recording(position=np.round(s["position"] / step) * step), MODEL)
    (remark,) = (r for r in found if r.kind == "quantised")
    assert (remark.channel, remark.severity) == ("position", severity)
    assert f"{step:.3g} m" in remark.message


def test_fine_grid_is_silent():
    s = signals()
    assert quality(recording(position=np.round(s["position"], 7)), MODEL) == ()


def test_clipped_sensor():
    s = signals()
    top = np.percentile(s["pressure_a"], 97)
    remark = only(
        quality(recording(pressure_a=np.minimum(s["pressure_a"], top)), MODEL), "clipped", "pressure_a"
    )
    assert "highest" in remark.message
    assert remark.interval[1] > remark.interval[0]


def test_stuck_sensor():
    s = signals()
    s["pressure_a"][3000:3050] = s["pressure_a"][3000]
    remark = only(quality(recording(**s), MODEL), "stuck", "pressure_a")
    assert remark.interval == pytest.approx((3.0, 3.05))


def test_a_coarse_sensor_at_rest_is_not_stuck():
    s = signals()
    s["position"][2000:3000] = s["position"][2000]
    coarse = np.round(s["position"] / 1e-3) * 1e-3
    assert not {"stuck", "clipped"} & {r.kind for r in quality(recording(position=coarse), MODEL)}


def test_a_signal_without_noise_may_rest():
    position = np.concatenate((np.zeros(1000), 0.1 * np.sin(np.arange(N - 1000) * 4e-3)))
    assert not {"stuck", "clipped"} & {r.kind for r in quality(recording(position=position), MODEL)}


def test_dead_channels_are_errors():
    assert ("still", "command") in kinds(quality(recording(command=np.zeros(N)), MODEL))
    noise = np.random.default_rng(0).normal(0, 3e-5, N)
    remark = quality(recording(position=noise), MODEL)[0]
    assert (remark.kind, remark.channel, remark.severity) == ("still", "position", "error")


def test_one_direction_one_speed():
    s = signals()
    assert ("excitation", "command") in kinds(quality(recording(command=np.abs(s["command"])), MODEL))
    noise = np.random.default_rng(0).normal(0, 3e-5, N)
    found = quality(recording(position=np.linspace(-0.1, 0.1, N) + noise), MODEL)
    messages = " ".join(r.message for r in found if r.channel == "position")
    assert "reverses never" in messages
    assert "range of speeds" in messages


@pytest.mark.parametrize("shift", [40, 100])
def test_motion_before_its_command_is_out_of_step(shift):
    s = signals()
    late = np.concatenate((np.full(shift, s["command"][0]), s["command"][:-shift]))
    found = quality(recording(command=late), MODEL)
    assert {("lag", "position"), ("lag", "pressure_a")} & kinds(found)
    assert {r.kind for r in found} == {"lag"}


def test_lag_is_measured():
    rng = np.random.default_rng(0)
    cause = np.convolve(rng.normal(size=5000), np.ones(20), "same")
    found = lag(cause, -np.roll(cause, 30), 1e-3)
    assert found.seconds == pytest.approx(0.03)
    assert found.correlation > 0.95 > found.chance
    assert lag(np.roll(cause, 30), cause, 1e-3).seconds == pytest.approx(-0.03)


def test_unrelated_channels_have_no_lag():
    """Slow signals correlate by chance; that chance is read off the record, so few are taken for related."""
    wrong = 0
    for seed in range(50):
        rng = np.random.default_rng(seed)
        a, b = (np.convolve(rng.normal(size=4000), np.ones(100), "same") for _ in range(2))
        found = lag(a, b, 1e-3)
        wrong += found.correlation > found.chance
    assert wrong <= 10  # near lags are an eighth of all looked at: by chance one in eight has the highest


@pytest.mark.parametrize("frequency", [0.5, 2.0, 5.0])
@pytest.mark.parametrize("delay", [0.015, 0.06])
def test_a_sine_tells_no_order(frequency, delay):
    """What repeats comes before as much as after: every lag of a sine is ambiguous."""
    t = np.arange(N) * DT
    rng = np.random.default_rng(0)
    position = 0.05 * np.sin(2 * np.pi * frequency * (t - delay)) + rng.normal(0, 3e-5, N)
    s = {"command": 0.5 * np.cos(2 * np.pi * frequency * t), "position": position}
    assert "lag" not in {r.kind for r in quality(recording(**s), MODEL)}


def test_an_output_that_follows_the_command_itself_is_in_step():
    """A spring-loaded axis: position follows command, so its speed comes first, and rightly so."""
    s = signals()
    noise = np.random.default_rng(0).normal(0, 3e-5, N)
    position = 0.1 * np.concatenate((np.full(5, s["command"][0]), s["command"][:-5])) + noise
    assert quality(recording(position=position, pressure_a=s["pressure_a"]), MODEL) == ()


def test_an_absent_input_is_refused():
    without = recording()
    without = replace(without, channels={"position": without["position"]})
    with pytest.raises(RecordingError, match="command"):
        quality(without, MODEL)


def test_a_pressure_that_falls_on_the_way_and_rises_at_the_stop_has_no_sign():
    """A cylinder of unequal areas: the pressure on its large side falls while it moves out, and rises at the end."""
    rig = read_rig(DATA / "servo_hydraulic.toml")
    t = np.arange(4000) * DT
    for size, sign in (
        (0.05, -1),
        (0.44, 0),
    ):  # shares of the valve's opening: the larger one reaches the stop
        command = size * np.sign(np.sin(2 * np.pi * t))
        recording = Recording("a", t, {"command": Channel("command", "u", "1", command)})
        found = signs(rig.model, rig.parameters, recording)
        assert found["command", "pressure_a"] == sign
        assert (found["command", "position"], found["command", "pressure_b"]) == (1, -1)
