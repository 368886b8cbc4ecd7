"""The arrays a fit works on: recordings cut into segments, segments into windows that begin at nodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from optid.core.model import CLOCK, INTERVAL, Array, Model
from optid.core.recording import Recording, held
from optid.errors import RecordingError

Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Problem:
    """Samples of all segments one after the other, and the windows over them.

    Attributes:
        time: s of each sample's own recording, (samples,).
        dt: time to the next sample, (samples,).
        inputs: held commands, (samples, inputs).
        measured: outputs, (samples, outputs); NaN is missing.
        begins: first sample of each window, (windows,).
        counts: intervals of each window.
        closed: the window's last sample is its own: nothing follows in its segment.
        linked: the window's end should meet the next window's node.
        recording: index of the recording each window belongs to.
    """

    time: Array
    dt: Array
    inputs: Array
    measured: Array
    begins: Integers
    counts: Integers
    closed: Booleans
    linked: Booleans
    recording: Integers


def pose(model: Model, recordings: Sequence[Recording], window: float) -> Problem:
    """Cut recordings into windows of about `window` seconds.

    Raises:
        RecordingError: a recording lacks an input, or holds none of the model's outputs.
    """
    columns: list[tuple[Array, Array, Array, Array]] = []
    begins, counts, closed, owner = [], [], [], []
    offset = 0
    for number, recording in enumerate(recordings):
        for segment in recording.segments():
            n = len(segment)
            columns.append(_arrays(model, segment, recording.time[0]))
            pieces = max(1, min(round(segment.duration / window), (n - 1) // 2))
            edges = np.round(np.linspace(0, n - 1, pieces + 1)).astype(int)
            begins += [offset + int(e) for e in edges[:-1]]
            counts += [int(c) for c in np.diff(edges)]
            closed += [False] * (pieces - 1) + [True]
            owner += [number] * pieces
            offset += n
    time, dt, inputs, measured = (np.ascontiguousarray(np.concatenate(c)) for c in zip(*columns, strict=True))
    ends = np.array(closed)
    return Problem(
        time,
        dt,
        inputs,
        measured,
        np.array(begins, dtype=np.int64),
        np.array(counts, dtype=np.int64),
        ends,
        ~ends,
        np.array(owner, dtype=np.int64),
    )


def _arrays(model: Model, segment: Recording, start: float) -> tuple[Array, Array, Array, Array]:
    n = len(segment)
    dt = np.diff(segment.time, append=segment.time[-1] + segment.interval)
    inputs = np.empty((n, len(model.inputs)))
    for j, port in enumerate(model.inputs):
        if port.role in (INTERVAL, CLOCK):
            column = dt if port.role == INTERVAL else segment.time - start + dt / 2
        else:
            column = held(segment[port.role].values)
        inputs[:, j] = np.r_[np.full(port.ago, column[0]), column][:n]
    measured = np.full((n, len(model.outputs)), np.nan)
    present = [j for j, port in enumerate(model.outputs) if port.role in segment]
    if not present:
        raise RecordingError(
            "no output of the model is measured",
            where=segment.name,
            expected=" or ".join(port.role for port in model.outputs),
        )
    for j in present:
        measured[:, j] = segment[model.outputs[j].role].values
    return segment.time, dt, inputs, measured
