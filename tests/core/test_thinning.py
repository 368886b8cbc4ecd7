"""Recordings brought down to a kilohertz: the same motion, less noise, the same impulse of the command."""

from dataclasses import replace

import numpy as np
import pytest

from optid.core.decimation import at_samples_of, decimated
from optid.core.recording import Channel, Recording
from optid.quality.noise import colour, noise_sd


def record(rate: float, noise: float = 0.0, seconds: float = 2.0) -> Recording:
    rng, time = np.random.default_rng(1), np.arange(round(seconds * rate)) / rate
    position = 0.05 * np.sin(2 * np.pi * 1.5 * time) + noise * rng.standard_normal(len(time))
    command = np.sign(np.sin(2 * np.pi * 0.7 * time)) * 0.3 + 0.1 * rng.standard_normal(len(time))
    return Recording(
        "fast",
        time,
        {
            "command": Channel("command", "u", "1", command),
            "position": Channel("position", "x", "m", position, sd=noise or None),
        },
    )


@pytest.mark.parametrize("rate", [2000.0, 5000.0, 10000.0])
def test_the_motion_stays_and_the_noise_falls(rate):
    slow, clean = decimated(record(rate, 3e-5), ["command"]), decimated(record(rate), ["command"])
    count = rate / 1000.0
    assert slow.rate == pytest.approx(1000.0)
    exact = 0.05 * np.sin(2 * np.pi * 1.5 * clean.time)
    assert clean["position"].values == pytest.approx(exact, abs=4e-7)
    noise = (slow["position"].values - clean["position"].values)[1:-1]
    assert np.std(noise) == pytest.approx(slow["position"].sd, rel=0.1)
    assert 0.85 < slow["position"].sd / (3e-5 / np.sqrt(count)) < 1.0 + 1e-9
    whole, few = record(rate)["command"].values, slow["command"].values
    assert few == pytest.approx(whole.reshape(-1, int(count)).mean(axis=1))


@pytest.mark.parametrize("rate", [2000.0, 5000.0, 16000.0])
def test_white_noise_stays_white(rate):
    """Coloured noise would count as more than there is, in searches and in intervals."""
    values = decimated(record(rate, 3e-5, seconds=10.0), ["command"])["position"].values
    clean = decimated(record(rate, seconds=10.0), ["command"])["position"].values
    noise = values - clean
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.05
    assert colour(values) == 0.0
    assert noise_sd(values) == pytest.approx(3e-5 / np.sqrt(rate / 1000.0), rel=0.05)


def test_what_is_missing_shifts_nothing():
    fast = record(10000.0)
    values = fast["position"].values.copy()
    values[500:507] = np.nan  # most of one block, at one side of its middle
    values[1000] = np.nan
    channels = {**fast.channels, "position": replace(fast["position"], values=values)}
    slow = decimated(replace(fast, channels=channels), ["command"])
    known = np.isfinite(slow["position"].values)
    assert not known[50]
    assert known[100]
    exact = 0.05 * np.sin(2 * np.pi * 1.5 * slow.time)
    assert slow["position"].values[known] == pytest.approx(exact[known], abs=2e-7)


def test_slow_recordings_stay_as_they_are_and_gaps_are_kept():
    slow = record(1000.0)
    assert decimated(slow, ["command"]) is slow
    fast = record(10000.0)
    keep = np.r_[0:500, 700 : len(fast)]
    channels = {k: replace(c, values=c.values[keep]) for k, c in fast.channels.items()}
    gappy = replace(fast, time=fast.time[keep], channels=channels)
    slow = decimated(gappy, ["command"])
    assert slow.rate == pytest.approx(1000.0)
    np.testing.assert_allclose(slow.gaps(), [(0.049, 0.07)])
    exact = 0.05 * np.sin(2 * np.pi * 1.5 * slow.time)
    assert slow["position"].values == pytest.approx(exact, abs=4e-7)
    keep = np.flatnonzero(np.random.default_rng(0).random(len(fast)) < 0.5)
    torn = fast.taken(keep)
    assert decimated(torn, ["command"]) is torn


def test_nothing_is_folded_into_the_band():
    """A tone just above the new Nyquist frequency, which a mere average would let through at a third of its height."""
    fast = record(250_000.0, seconds=0.2)
    tone = 0.01 * np.sin(2 * np.pi * 900.0 * fast.time)
    channels = {**fast.channels, "position": replace(fast["position"], values=fast["position"].values + tone)}
    slow = decimated(replace(fast, channels=channels), ["command"])
    exact = 0.05 * np.sin(2 * np.pi * 1.5 * slow.time)
    assert np.abs(slow["position"].values - exact)[5:-5].max() < 1e-4


def test_a_slow_channel_gives_its_rows_and_commands_are_averaged_between_them():
    fast = record(1000.0)
    sparse = np.full(len(fast), np.nan)
    sparse[::10] = fast["position"].values[::10]
    channels = {**fast.channels, "position": replace(fast["position"], values=sparse)}
    found = at_samples_of(replace(fast, channels=channels), "position", ["command"])
    assert found.interval == pytest.approx(0.01)
    means = fast["command"].values.reshape(-1, 10).mean(axis=1)
    np.testing.assert_allclose(found["command"].values[:-1], means[:-1])
    assert at_samples_of(fast, "position", ["command"]) is fast


@pytest.mark.parametrize("rows", [8, 50, 3])  # from one sample of the slow channel to the next, before
def test_a_channel_slower_than_the_rest_keeps_its_samples(rows):
    t = np.arange(40_000) * 1e-4
    x = 0.1 * np.sin(12 * t)
    slow = np.full(len(t), np.nan)
    slow[2::rows] = x[2::rows]
    command = Channel("command", "u", "1", np.sign(x), held=True)
    whole = Recording("two rates", t, {"command": command, "position": Channel("position", "x", "m", slow)})
    found = decimated(whole, ["command"], 1000.0)
    y = found["position"].values
    known = np.isfinite(y)
    assert known.sum() >= 0.95 * len(t) / max(rows, 10)
    # A slope over two samples is wrong by the curvature; a straight line between them by an eighth of it.
    np.testing.assert_allclose(y[known], 0.1 * np.sin(12 * found.time[known]), atol=6e-6)
