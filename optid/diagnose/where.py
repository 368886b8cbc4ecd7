"""When, and where in state space, an effect is at work: the share of the innovations that it carries."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from optid.core.model import Array
from optid.core.recording import Recording
from optid.fit.likelihood import run_steered
from optid.fit.place import Answer
from optid.fit.prediction import horizon
from optid.fit.problem import Integers

SLOT = 0.2  # of a window: resolution of the intervals; 0.1 s where sampling is fast
LOUD = 0.1  # of the loudest slot's energy: a slot above it belongs to an interval
COVER = 0.8  # share of the mismatch that a range of a signal should hold
PIECES = 40  # of a signal's range, each holding as many samples
TELLING = 1.25  # times the samples' share that a range must hold of the mismatch to be worth telling


@dataclass(frozen=True)
class Range:
    """Between which values of a signal which share of the mismatch lies; SI."""

    low: float
    high: float
    unit: str
    share: float
    occupancy: float


@dataclass(frozen=True, eq=False)
class Region:
    """Where a mismatch is.

    Attributes:
        channels: outputs that show it.
        intervals: (recording, from, to), s.
        states: signal -> range.
        energy: of the mismatch at each sample, in squared sd of the innovations, (samples,).
        signals: name -> (values at the samples, unit).
        owner, time: recording and time of each sample.
        slot: resolution of the intervals, s.
    """

    channels: tuple[str, ...]
    intervals: tuple[tuple[str, float, float], ...]
    states: Mapping[str, Range]
    energy: Array
    signals: Mapping[str, tuple[Array, str]]
    owner: Integers
    time: Array
    slot: float


def contribution(answer: Answer, without: Array) -> Array:
    """What a part of a model does to the scaled innovations, (samples, outputs): against the parameters `without`."""
    q, f = answer.question, answer.filtered
    own = range(len(q.model.states))
    both = run_steered(q.model, q.problem, np.stack([answer.p, without]), f, own)
    return np.asarray((both[1] - both[0]) / np.sqrt(f.variances[0]))


def region(answer: Answer, mismatch: Array, recordings: tuple[Recording, ...]) -> Region:
    """Intervals and ranges of a mismatch given as scaled innovations, (samples, outputs)."""
    problem = answer.question.problem
    by_output = np.nansum(np.where(np.isfinite(mismatch), mismatch, 0.0) ** 2, axis=0)
    outputs = answer.question.model.outputs
    channels = tuple(
        port.role
        for port, e in zip(outputs, by_output, strict=True)
        if e > 0.2 * max(by_output.max(), 1e-300)
    )
    energy = np.nansum(np.where(np.isfinite(mismatch), mismatch, 0.0) ** 2, axis=1)
    owner = np.repeat(problem.recording, problem.counts + 1)
    signals = _signals(answer, owner)
    states = {name: _range(values, energy, unit) for name, (values, unit) in signals.items()}
    slot = SLOT * horizon(float(np.median(problem.dt)))
    intervals = _intervals(energy, owner, problem.time, recordings, slot)
    return Region(channels, intervals, states, energy, signals, owner, problem.time, slot)


def telling(states: Mapping[str, Range], always: tuple[str, ...]) -> dict[str, Range]:
    """The ranges of the signals `always` told, then those with clearly more of the mismatch than of the samples."""
    ranked = sorted(states.items(), key=lambda item: -item[1].share / max(item[1].occupancy, 1e-9))
    sharp = [(name, r) for name, r in ranked if r.share > TELLING * r.occupancy][:3]
    return {name: states[name] for name in always if name in states} | dict(sharp)


def _signals(answer: Answer, owner: Integers) -> dict[str, tuple[Array, str]]:
    q, X = answer.question, answer.filtered.states[0]
    found: dict[str, tuple[Array, str]] = {}
    for i, state in enumerate(q.model.states):
        if state.unit != "1" and "." not in state.name:
            found[state.name] = (X[:, i], state.unit)
    for j, port in enumerate(q.model.inputs):
        if port in q.model.recorded:
            values = q.problem.inputs[:, j]
            found[port.role] = (values, port.unit)
            rate = np.diff(values, prepend=values[:1])
            rate[np.diff(owner, prepend=owner[:1]) != 0] = 0.0
            found[f"{port.role}_rate"] = (rate / q.problem.dt, f"{port.unit}/s")
    found["time"] = (q.problem.time, "s")
    return found


def _range(values: Array, energy: Array, unit: str) -> Range:
    """The range with the fewest samples that holds `COVER` of the energy."""
    good = np.isfinite(values)
    v, e = values[good], energy[good]
    total = float(e.sum())
    if not len(v) or total <= 0.0:
        return Range(float("nan"), float("nan"), unit, 0.0, 1.0)
    edges = np.unique(np.quantile(v, np.linspace(0, 1, PIECES + 1)))
    if len(edges) < 3:
        return Range(float(edges[0]), float(edges[-1]), unit, 1.0, 1.0)
    piece = np.clip(np.searchsorted(edges, v, side="right") - 1, 0, len(edges) - 2)
    held = np.r_[0.0, np.cumsum(np.bincount(piece, weights=e, minlength=len(edges) - 1))] / total
    count = np.r_[0.0, np.cumsum(np.bincount(piece, minlength=len(edges) - 1))] / len(v)
    best = (2.0, 0, len(edges) - 1)
    for a in range(len(edges) - 1):
        b = int(np.searchsorted(held, held[a] + COVER - 1e-12))
        if b < len(edges) and count[b] - count[a] < best[0]:
            best = (float(count[b] - count[a]), a, b)
    _, a, b = best
    return Range(float(edges[a]), float(edges[b]), unit, float(held[b] - held[a]), float(count[b] - count[a]))


def _intervals(
    energy: Array, owner: Integers, time: Array, recordings: tuple[Recording, ...], slot: float
) -> tuple[tuple[str, float, float], ...]:
    slots = np.floor(time / slot).astype(int)
    loudest, sums = 0.0, []
    for number in range(len(recordings)):
        mine = owner == number
        first = int(slots[mine].min()) if mine.any() else 0
        total = np.bincount(slots[mine] - first, weights=energy[mine])
        sums.append((first, total))
        loudest = max(loudest, float(total.max()) if len(total) else 0.0)
    found = []
    for recording, (first, total) in zip(recordings, sums, strict=True):
        loud = np.flatnonzero(total > LOUD * loudest)
        for run in np.split(loud, np.flatnonzero(np.diff(loud) > 2) + 1) if len(loud) else []:
            begin, end = (first + run[0]) * slot, (first + run[-1] + 1) * slot
            file = recording.name
            found.append(
                (file, round(max(begin, recording.time[0]), 6), round(min(end, recording.time[-1]), 6))
            )
    return tuple(found)
