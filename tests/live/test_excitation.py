"""Experiments in open loop: what `--command` means, what is put, and that every command reads the recording."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from optid.core.readers import read_recording
from optid.errors import InputError
from optid.live.excitation import REST, TAIL, read_command
from optid.live.loop import Choices
from optid.live.settings import live_settings
from optid.pid.controller import Gains
from optid.quality.quality import quality
from optid.rigs.rigfile import read_rig


@pytest.fixture
def command(bench):
    def read(text, **changes):
        settings = live_settings(bench, 100.0)
        settings = replace(settings, limits=replace(settings.limits, **changes))
        return read_command(text, bench, settings, "command", "V")

    return read


def values(excitation, *times):
    return [excitation.at(REST + time) for time in times]


def test_pulses_steps_and_ramps(command):
    pulse = command("impulse 2 V 40 ms")
    assert [pulse.at(t) for t in (0.0, 0.49)] == [0.0, 0.0]
    assert values(pulse, 0.0, 0.039, 0.041, 9.0) == [2.0, 2.0, 0.0, 0.0]
    assert pulse.seconds == pytest.approx(REST + 0.04 + 2 * TAIL)
    assert values(command("steps -1 V 0.5 s"), 0.1, 0.6, 1.1, 1.6) == [-1.0, 0.0, 1.0, 0.0]
    assert values(command("step 1 V 0.5 s, rest 1 s, step 500 mV 1 s"), 0.1, 0.6, 1.6, 2.6) == [
        1.0,
        0.0,
        0.5,
        0.0,
    ]
    assert values(command("ramp -1 V 1 V 2 s"), 0.0, 1.001, 1.999, 2.1) == pytest.approx(
        [-1.0, 0.0, 0.99, 0.0]
    )
    assert command("impulse 2 V 40 ms", safe=0.5).values == (0.5, 2.0, 0.5, 0.5)
    assert values(command("steps 1 V 0.5 s", safe=0.25), 0.1, 0.6, 1.1) == [1.0, 0.25, -0.5]


def test_a_multisine_has_its_lines_and_its_size(command):
    wave = np.array(command("multisine 1.5 V 1 Hz 10 Hz 4 s").values[1:-1])
    assert np.abs(wave).max() == pytest.approx(1.5)
    size = np.abs(np.fft.rfft(wave)) / wave.size
    lines = np.flatnonzero(size > 1e-6) / 4.0
    assert (lines[0], lines[-1], lines.size) == (1.0, 10.0, 37)
    np.testing.assert_allclose(size[size > 1e-6], size.max())


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("impuls 2 V 40 ms", 'did you mean "impulse"'),
        ("impulse 2 V", "values in V, s"),
        ("impulse 2 mm 40 ms", "impulse"),
        ("impulse 2 V 40 ms x", "values in V, s"),
        ("impulse 2 V -40 ms", "more than 0"),
        ("impulse 9 V 40 ms", "9 V lies beyond the command limits; expected -5 to 5 V"),
        ("multisine 1 V 10 Hz 80 Hz 1 s", "less than 50 Hz"),
        ("multisine 1 V 0.1 Hz 0.2 Hz 1 s", "a line of 1 Hz"),
        ("", "impulse 2 V 40 ms"),
        ("nothing.csv", "or a recording"),
    ],
)
def test_wrong_words_are_refused(command, text, words):
    with pytest.raises(InputError, match=words):
        command(text)


def test_a_recordings_command_is_put_again(bench, command):
    path = bench.path.with_name("bench.csv")
    excitation, source = command(str(path)), pd.read_csv(path)
    assert excitation.at(1.0005) == pytest.approx(source["u"][1000])
    assert excitation.at(1e3) == 0.0


@pytest.fixture
def slow(bench, tmp_path):
    """The bench at 250 Hz, with a fence."""
    path = tmp_path / "slow.toml"
    table = '[live]\nrate = "250 Hz"\nspeed_limit = "0.3 m/s"\ntravel_limit = "30 mm"\n'
    path.write_text(f"{bench.source}\n{table}", encoding="utf-8")
    return read_rig(path)


def test_what_is_asked_is_put_and_the_log_is_a_recording(slow, run_live):
    excitation = read_command("impulse 1 V 40 ms", slow, live_settings(slow), "command", "V")
    choices = Choices(Gains(0.0), command=excitation)
    end, loop, path = run_live(slow, seconds=1.6, choices=choices)
    assert (end.samples, end.held_back) == (400, 0)
    record = read_recording(path, slow)
    put = record["command"].recorded
    assert np.flatnonzero(put).tolist() == list(range(125, 135))
    assert set(put[125:135]) == {1.0}
    assert not [remark for remark in quality(record, slow.model) if remark.severity == "error"]
    moved = record["position"].values[-1] - record["position"].values[0]
    assert moved > 2e-3
    assert loop.identifier.counts.learnt_from > 300


def test_a_long_push_is_stopped_by_the_fence(slow, run_live):
    excitation = read_command("step 2 V 2 s", slow, live_settings(slow), "command", "V")
    choices = Choices(Gains(0.0), command=excitation)
    end, _, path = run_live(slow, seconds=2.0, choices=choices)
    log = pd.read_csv(path)
    assert end.held_back > 50
    assert (
        25.0 < log["x"].max() - log["x"][0] < 50.0
    )  # mm; without the fence it runs to the end of the stroke
