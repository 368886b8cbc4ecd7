"""Channels of a recording on one even grid of samples, as a discrete model needs them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from optid.armax.signals import Signals
from optid.core.decimation import at_samples_of
from optid.core.model import Array
from optid.core.recording import Recording
from optid.errors import InputError, nearest

LONGEST_GAP = 1000  # samples kept of a gap: after any longer one the recursion begins anew all the same


@dataclass(frozen=True)
class Sampled:
    """Output and inputs on an even grid.

    Attributes:
        time: s on the recording's clock, shape (N,).
        signals: y in the output's SI unit, u in the inputs' recorded units; NaN where missing.
        sample_time: s.
        output, inputs: roles.
        output_unit, input_units: SI.
    """

    time: Array
    signals: Signals
    sample_time: float
    output: str
    inputs: tuple[str, ...]
    output_unit: str
    input_units: tuple[str, ...]


def resample(recording: Recording, output: str, inputs: Sequence[str]) -> Sampled:
    """Put every sample on the grid of the median interval; what was lost between samples is NaN.

    An output with a slower rate of its own gives the grid: the inputs are averaged over its intervals.

    Raises:
        InputError: a channel the recording does not hold, or one that is both input and output.
    """
    for role in (output, *inputs):
        if role not in recording:
            raise InputError(
                f'no channel "{role}"',
                where=recording.name,
                expected=f"one of {', '.join(recording.channels)}",
                hint=nearest(role, recording.channels),
            )
    if output in inputs or len(set(inputs)) < len(inputs):
        raise InputError(f'"{output}" from {", ".join(inputs)}', expected="channels that differ")
    recording = at_samples_of(recording, output, inputs)
    steps = np.clip(np.round(np.diff(recording.time) / recording.interval), 1, LONGEST_GAP).astype(np.int64)
    at = np.concatenate([[0], np.cumsum(steps)])
    time = np.interp(np.arange(at[-1] + 1), at, recording.time)
    columns = np.full((at[-1] + 1, 1 + len(inputs)), np.nan)
    columns[at, 0] = recording[output].values
    for i, role in enumerate(inputs):
        columns[at, 1 + i] = recording[role].recorded
    return Sampled(
        time,
        Signals(columns[:, 0].copy(), columns[:, 1:].copy()),
        recording.interval,
        output,
        tuple(inputs),
        recording[output].unit,
        tuple(recording[role].recorded_unit for role in inputs),
    )
