"""The arrays a fit works on: recordings cut into segments, segments into windows that begin at nodes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from optid.core.model import CLOCK, INTERVAL, Array, Model
from optid.core.recording import Recording, held
from optid.errors import RecordingError
from optid.estimation.initial_trajectory import measured_states

Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]

# Local error of the integration in filters, as a share of each state's usual size.
TOLERANCE = 1e-5
HORIZON = 0.5  # s, of a window
FEWEST = 50  # samples of a window where sampling is too slow for that many in HORIZON
SHORTEST, MANY = 4, 8  # smallest number of windows of a recording; number for a shorter one
FEW = 6  # samples of a line that estimates a speed
EVIDENT = 3.0  # sd of that line's slope


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
        tolerance: local error of the integration in filters, as a share of each state's usual size.
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
    tolerance: float = TOLERANCE


def window_seconds(interval: float, duration: float = math.inf) -> float:
    """Length of a window, s, of a recording with a sample every `interval` seconds.

    Args:
        interval: s.
        duration: s, if windows are to be compared with each other: a recording of fewer than `SHORTEST` windows is
            divided into `MANY` shorter ones, as far as its samples allow.
    """
    horizon = HORIZON if duration >= SHORTEST * HORIZON else duration / MANY
    return max(horizon, FEWEST * interval)


def node_distance(recordings: Iterable[Recording]) -> float:
    """Seconds between the nodes of a fit: half a window of the recording that is sampled most slowly.

    Long compared with friction's microseconds, short compared with the pressures' drift.
    """
    return window_seconds(max(recording.interval for recording in recordings)) / 2


def build_problem(model: Model, recordings: Sequence[Recording], window: float) -> Problem:
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
    positions = set(measured_states(model)[1].values())
    rests = not any(_moves(segment.time, measured[:, j]) for j in positions.intersection(present))
    inputs = np.empty((n, len(model.inputs)))
    for j, port in enumerate(model.inputs):
        if port.role in (INTERVAL, CLOCK):
            column = dt if port.role == INTERVAL else segment.time - start + dt / 2
        else:
            column = held(segment[port.role].values)
        before = port.idle if rests and port.idle is not None else column[0]
        inputs[:, j] = np.r_[np.full(port.ago, before), column][:n]
    return segment.time, dt, inputs, measured


def _moves(time: Array, position: Array) -> bool:
    """Whether it clearly moves at the start of the segment, and does not just break away, when it soon gets faster."""
    known = np.flatnonzero(np.isfinite(position))[: 2 * FEW]
    if len(known) < 2 * FEW:
        return False
    first, then = (_slope(time[rows], position[rows]) for rows in (known[:FEW], known[FEW:]))
    return abs(first[0]) > max(EVIDENT * first[1], abs(then[0]) / 2.0)


def _slope(time: Array, values: Array) -> tuple[float, float]:
    """Slope of a line through the values, with its sd."""
    (slope, _), covariance = np.polyfit(time - time[0], values, 1, cov=True)
    return float(slope), float(np.sqrt(covariance[0, 0]))


def window_numbers(time: Array, seconds: float) -> Integers:
    """The window of this length in which each time since the first lies; less than half a one joins the last.

    A time at the end of a window, but for rounding, lies in the next.
    """
    last = max(round(float(time[-1]) / seconds), 1) - 1
    return np.minimum(np.floor(time / seconds + 1e-9).astype(np.int64), last)


def cut_into(whole: Problem, length: float) -> Problem:
    """The segments of a problem cut into windows."""
    begins, counts, closed, recording = [], [], [], []
    for begin, count, owner in zip(
        whole.begins.tolist(), whole.counts.tolist(), whole.recording.tolist(), strict=True
    ):
        time = whole.time[begin : begin + count + 1]
        number = window_numbers(time - time[0], length)
        heads = [0, *(np.flatnonzero(np.diff(number)) + 1).tolist()]
        heads = [h for h in heads if h < count]
        begins += [begin + h for h in heads]
        counts += np.diff([*heads, count]).tolist()
        closed += [False] * (len(heads) - 1) + [True]
        recording += [owner] * len(heads)
    return replace(
        whole,
        begins=np.array(begins),
        counts=np.array(counts),
        closed=np.array(closed),
        recording=np.array(recording),
        linked=np.zeros(len(begins), dtype=np.bool_),
    )


def window_index(cut: Problem) -> Integers:
    """The window in which each sample lies, (samples,)."""
    return np.searchsorted(cut.begins, np.arange(len(cut.time)), side="right") - 1


def window_means(values: Array, index: Integers) -> Array:
    """Mean of the known values (samples, outputs) of each window, (windows, outputs); NaN where it has none."""
    means = np.full((int(index.max()) + 1, values.shape[1]), np.nan)
    for j in range(values.shape[1]):
        known = np.isfinite(values[:, j])
        count = np.bincount(index[known], minlength=len(means))
        total = np.bincount(index[known], weights=values[known, j], minlength=len(means))
        means[count > 0, j] = total[count > 0] / count[count > 0]
    return means


def window_blocks(owner: Integers, time: Array, seconds: float) -> Integers:
    """The windows of all recordings, `owner` of each sample, numbered through, (samples,)."""
    pairs = np.stack([owner, np.floor(time / seconds + 1e-9).astype(np.int64)])
    return np.unique(pairs, axis=1, return_inverse=True)[1].ravel()
