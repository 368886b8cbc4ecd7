"""Fast recordings brought down to the rate at which an axis still shows all it does, without losing information."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from optid.core.recording import Channel, Recording, held

Integers = NDArray[np.int64]

# Hz: pressures take milliseconds, and what averaging leaves out of a millisecond of motion is below a micrometre.
FASTEST = 1000.0
WHOLE = 0.75  # of a block that must be measured for its average to count


def thinned(recording: Recording, commands: Iterable[str], fastest: float = FASTEST) -> Recording:
    """A recording of at most about `fastest` samples a second; slower ones come back as they are.

    Measured channels are averaged around the new samples, so that their noise falls as if they had been measured so
    often; held ones over the time until the next sample. A recording with gaps stays as it is.

    Args:
        recording: evenly sampled.
        commands: their roles; they hold from each sample to the next.
        fastest: Hz.
    """
    count = int(recording.rate / fastest * (1 + 1e-6))
    if count < 2 or recording.gaps() or len(recording) < 4 * count:
        return recording
    inputs = set(commands)
    rows: Integers = np.arange(0, len(recording) - count + 1, count)
    channels = {
        role: _averaged(channel, rows, count, role in inputs) for role, channel in recording.channels.items()
    }
    return replace(recording, time=recording.time[rows], channels=channels)


def _averaged(channel: Channel, rows: Integers, count: int, is_held: bool) -> Channel:
    values, known = channel.values, np.isfinite(channel.values)
    if not known.any():
        return replace(channel, values=values[rows])
    # An even number of samples has no middle one: a block around it ends in two that count half.
    weights = np.ones(count if is_held or count % 2 else count + 1)
    if len(weights) > count:
        weights[[0, -1]] = 0.5
    weights /= weights.sum()
    first = 0 if is_held else -(count // 2)
    places = np.clip(rows[:, None] + first + np.arange(len(weights)), 0, len(values) - 1)
    at = np.arange(float(len(values)))
    filled = held(values) if is_held else np.interp(at, at[known], values[known])
    mean = np.where(known[places] @ weights > WHOLE, filled[places] @ weights, np.nan)
    if not is_held:  # at the ends the block reaches beyond the recording
        inside = (rows + first >= 0) & (rows + first + len(weights) <= len(values))
        mean = np.where(inside, mean, values[rows])
    sd = None if channel.sd is None else channel.sd * float(np.linalg.norm(weights))
    return replace(channel, values=mean, sd=sd)
