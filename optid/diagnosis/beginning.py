"""Beginnings that mislead: at rest, in pressures that nothing shows, a filter may take on what is wrong for seconds.

A filter that begins in fast motion soon sees what it does not know. It has seen less than one that followed the
recording from its first sample, and so predicts what comes then no better, unless the other was misled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from optid.core.model import Array
from optid.core.recording import LONG_GAP, Recording
from optid.diagnosis.candidate import Candidate, Data
from optid.estimation.likelihood import WHOLE, deviance, run_filter
from optid.estimation.prediction import horizon
from optid.estimation.problem import Integers, pose

FAST = 1 / 6  # share of a segment's samples that count as fast motion
SWIFT = 0.1  # of a window, to either side: over which motion counts
REST = 0.2  # of a window: a beginning that is no longer is in motion at once
CLOCK = 2  # samples that stay, as a recording's clock counts from its first one


def begun(base: Candidate, data: Data) -> Data:
    """The same without the beginnings that mislead the base model's filter; `data` itself where none does."""
    train = [_begun(base, one) for one in data.train]
    late = tuple(one.name for one, given in zip(train, data.train, strict=True) if one is not given)
    return replace(data, train=tuple(train), late=late) if late else data


def _begun(base: Candidate, recording: Recording) -> Recording:
    """Each segment from its first fast motion on, where that predicts better what follows."""
    begins, deviances = _filtered(base, recording)
    ends = [*begins[1:], len(recording)]
    starts = [_fast(base, recording, a, b) for a, b in zip(begins, ends, strict=True)]
    rows = _rows(begins, starts, ends)
    if len(rows) == len(recording):
        return recording
    late = np.full(len(recording), np.nan)
    late[rows] = _filtered(base, recording.taken(rows))[1]
    better = [
        start if float(np.sum(late[start:end] - deviances[start:end])) < 0.0 else begin
        for begin, start, end in zip(begins, starts, ends, strict=True)
    ]
    return recording if better == begins else recording.taken(_rows(begins, better, ends))


def _filtered(base: Candidate, recording: Recording) -> tuple[list[int], Array]:
    """First rows of the segments, and -2 log likelihood of each row at the base model's parameters."""
    model, answer = base.rig.model, base.answer
    problem = pose(model, [recording], WHOLE)
    Q = answer.noise.spectrum(len(model.states))[None]
    f = run_filter(model, problem, answer.p[None], Q, answer.noise.measurement[None])
    rows = np.searchsorted(recording.time, problem.time)  # a segment of one sample is left out
    each = np.zeros(len(recording))
    each[rows] = deviance(f.innovations[0], f.variances[0])
    return rows[problem.begins].tolist(), each


def _fast(base: Candidate, recording: Recording, begin: int, end: int) -> int:
    """First row of fast motion in a segment; its beginning if it begins in motion."""
    outputs = [port.role for port in base.rig.model.outputs]
    swift = _swiftness(recording, outputs)[begin:end]
    first = int(np.argmax(swift >= np.quantile(swift, 1.0 - FAST)))
    rest = max(REST * horizon(recording.interval) / recording.interval, CLOCK + LONG_GAP)
    return begin + first if first > rest else begin


def _rows(begins: Sequence[int], starts: Sequence[int], ends: Sequence[int]) -> Integers:
    """What stays if segments begin at `starts`."""
    clock = np.arange(min(CLOCK, starts[0]))
    return np.concatenate([clock, *(np.arange(a, b) for a, b in zip(starts, ends, strict=True))]).astype(int)


def _swiftness(recording: Recording, outputs: Sequence[str]) -> Array:
    """How far outputs go within a tenth of a window to either side, in their sd, squared, (rows,)."""
    reach = max(1, round(SWIFT * horizon(recording.interval) / recording.interval))
    total = np.zeros(len(recording))
    apart = recording.time[2 * reach :] - recording.time[: -2 * reach]
    whole = apart < (2 * reach + LONG_GAP) * recording.interval  # nothing moves across a gap
    for role in outputs:
        if role in recording:
            values = recording[role].values
            gone = (values[2 * reach :] - values[: -2 * reach]) / max(float(np.nanstd(values)), 1e-300)
            total[reach:-reach] += np.where(whole, np.nan_to_num(gone**2), 0.0)
    return total
