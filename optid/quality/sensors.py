"""What a sensor or its converter does to a signal: saturation, value grid, clipping, sticking."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from optid.core.recording import Channel, Recording
from optid.quality.noise import grid, scatter
from optid.quality.remark import Remark
from optid.quality.sampling import runs

Array = NDArray[np.float64]

CHANCE = 1e-6  # a run of equal values less likely than this, anywhere in the recording, is not a coincidence
_NOISELESS = 1e-6  # of a signal's span: no sensor resolves a millionth
_BLOCK = 20  # samples over which the share of equal neighbours is counted
_CANDIDATES = 5  # longest runs that are looked at


def saturation(recording: Recording, inputs: tuple[str, ...]) -> Iterator[Remark]:
    """Inputs at or beyond the full scale that the rig file states."""
    for role in inputs:
        channel = recording[role]
        if channel.full_scale is None:
            continue
        size, full = np.abs(channel.values), channel.full_scale
        slack = max(1e-6 * full, grid(channel.values))  # a converter may end one step short of it
        beyond = size > full + slack
        if beyond.any():
            yield Remark(
                "beyond_scale",
                "warning",
                role,
                f"{role} reaches {np.nanmax(size) / full:.3g} times its full scale "
                f"({100 * beyond.mean():.2f} % of the time): the full scale in the rig file is too small, or the "
                "valve does not follow",
                _longest(beyond, recording),
            )
        at = (size >= full - slack) & ~beyond
        if at.any():
            yield Remark(
                "saturated",
                "note",
                role,
                f"{role} is at full scale for {100 * at.mean():.2f} % of the time",
                _longest(at, recording),
            )


def quantisation(recording: Recording, outputs: tuple[str, ...]) -> Iterator[Remark]:
    """Outputs whose value grid is too coarse for their noise to blur it.

    Noise of half a step makes the rounding error behave like white noise of its own (Widrow); below, it
    follows the signal. The error, grid/sqrt(12), bounds the fit any model can reach: a warning below 99 %.
    """
    for role in outputs:
        values = recording[role].values
        step = grid(values)
        noise = scatter(values, step)
        if step == 0.0 or noise >= step / 2:
            continue
        spread = float(np.nanstd(values))
        best = 100 * (1 - step / math.sqrt(12) / spread)
        # The decimals of a file are a grid as well: far below a model's accuracy they are not reported.
        if best > 99.99:
            continue
        yield Remark(
            "quantised",
            "warning" if best < 99 else "note",
            role,
            f"{role} moves in steps of {step:.3g} {recording[role].unit}, coarser than its noise: "
            f"no model can fit it better than {best:.2f} %",
        )


def constant_runs(recording: Recording, outputs: tuple[str, ...]) -> Iterator[Remark]:
    """Outputs that stay at one value longer than their own noise allows: clipped at a rail, or stuck.

    A sensor with noise hardly repeats a value, even at rest. The rate of repeats in the quietest tenth of the
    recording gives the probability of a longer run. Nothing is concluded where the noise does not blur the grid
    (less than half a step), nor does a signal without noise, such as a simulated one: both rest exactly.
    """
    for role in outputs:
        values = recording[role].values
        found = values[np.isfinite(values)]
        if found.size < 5 * _BLOCK or found.min() == found.max():
            continue  # a channel that never moves is reported elsewhere
        step = grid(values)
        if scatter(values, step) < max(step / 2, _NOISELESS * (found.max() - found.min())):
            yield from _at_end(recording, channel=recording[role])
            continue
        low, high = float(found.min()), float(found.max())
        at_rail = (values == low) | (values == high)
        channel = recording[role]
        for rail, name in ((low, "lowest"), (high, "highest")):
            yield from _clipped(recording, channel, values == rail, ~at_rail, f"{name} value {rail:.5g}")
        yield from _stuck(recording, channel, at_rail)


def _at_end(recording: Recording, channel: Channel) -> Iterator[Remark]:
    """A signal without visible noise that reaches its highest or lowest value and stays there."""
    values = channel.values
    moves = np.abs(np.diff(values))
    usual = float(np.nanmedian(moves[moves > 0])) if (moves > 0).any() else 0.0
    for name, rail in (("lowest", float(np.nanmin(values))), ("highest", float(np.nanmax(values)))):
        stays = [
            (a, b)
            for a, b in runs(values == rail)
            if b - a >= _BLOCK and a > 1 and abs(values[a - 1] - values[a - 2]) > usual
        ]
        if len(stays) > 1:
            yield Remark(
                "clipped",
                "note",
                channel.role,
                f"{channel.role} reaches its {name} value {rail:.5g} {channel.unit} {len(stays)} times and stays "
                "there: an end stop, or the end of the sensor's range",
                _span(recording, *stays[0]),
            )


def _clipped(
    recording: Recording, channel: Channel, rail: NDArray[np.bool_], others: NDArray[np.bool_], name: str
) -> Iterator[Remark]:
    first, last = max(runs(rail), key=lambda run: run[1] - run[0])
    repeat = _repeat_chance(channel.values, others)
    if _chance(repeat, last - first, len(rail)) < CHANCE:
        yield Remark(
            "clipped",
            "warning",
            channel.role,
            f"{channel.role} is exactly at its {name} {channel.unit} for {100 * rail.mean():.2f} % of the time, "
            f"up to {last - first} samples in a row, without its usual noise: the sensor is saturated there",
            _span(recording, first, last),
        )


def _stuck(recording: Recording, channel: Channel, at_rail: NDArray[np.bool_]) -> Iterator[Remark]:
    values = channel.values
    equal = np.diff(values) == 0
    longest = sorted(runs(equal), key=lambda run: run[0] - run[1])[:_CANDIDATES]
    for first, last in longest:
        if at_rail[first]:
            continue
        others = np.ones(len(values), dtype=bool)
        others[first : last + 1] = False
        if _chance(_repeat_chance(values, others), last + 1 - first, len(values)) < CHANCE:
            yield Remark(
                "stuck",
                "warning",
                channel.role,
                f"{channel.role} holds {values[first]:.5g} {channel.unit} for {last + 1 - first} samples "
                "without its usual noise: the sensor was stuck, or samples were repeated",
                _span(recording, first, last + 1),
            )


def _repeat_chance(values: Array, use: NDArray[np.bool_]) -> float:
    """Probability that a sample equals the one before where the signal is quietest, from the samples to use.

    The 90th percentile over blocks of the share of equal neighbours; one repeat is added to each block, as
    the rule of succession has it, so that no chance is zero.
    """
    pairs = use[1:] & use[:-1] & np.isfinite(values[1:]) & np.isfinite(values[:-1])
    equal = (np.diff(values) == 0)[pairs]
    blocks = equal.size // _BLOCK
    if blocks < 5:
        return 1.0
    share = (equal[: blocks * _BLOCK].reshape(blocks, _BLOCK).sum(axis=1) + 1) / (_BLOCK + 2)
    return float(np.percentile(share, 90))


def _chance(repeat: float, length: int, samples: int) -> float:
    """Expected number of runs of at least this length among so many samples."""
    return float(samples * repeat ** (length - 1))


def _longest(flags: NDArray[np.bool_], recording: Recording) -> tuple[float, float]:
    return _span(recording, *max(runs(flags), key=lambda run: run[1] - run[0]))


def _span(recording: Recording, first: int, last: int) -> tuple[float, float]:
    """Times of the first sample and of the one at or after the last."""
    return float(recording.time[first]), float(recording.time[min(last, len(recording) - 1)])
