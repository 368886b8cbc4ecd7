"""When an effect is active, and where in state space the mismatch lies: its share of the innovations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from optid.core.model import Array
from optid.core.recording import Recording
from optid.estimation.likelihood import run_fixed_gain_filter
from optid.estimation.likelihood_point import LikelihoodFit
from optid.estimation.problem import Booleans, Integers, Problem, window_seconds

SLOT = 0.2  # of a window: resolution of the map over time, 0.1 s where sampling is fast; shorter pauses are bridged
WORKS = 0.1  # of its largest in a recording: activity beyond which an effect counts as active
COVER = 0.8  # share of the mismatch that a range of a signal should contain
NOWHERE: Mapping[str, tuple[float, float]] = MappingProxyType({})
ALWAYS = 0.95  # share of the recordings' time in which something that always acts is active


@dataclass(frozen=True)
class Range:
    """A range of a signal and its share of the mismatch; SI. `by_law` is one that a law singles out."""

    low: float
    high: float
    unit: str
    share: float
    occupancy: float
    by_law: bool = False

    @property
    def informative(self) -> bool:
        """Whether clearly more of the mismatch than of the samples lies there."""
        return COVER * self.share > self.occupancy


@dataclass(frozen=True, eq=False)
class Region:
    """Where a mismatch is.

    Attributes:
        channels: outputs in which it is visible.
        intervals: (recording, from, to), s, in which it is active.
        states: signal -> range.
        energy: of the mismatch at each sample, in squared sd of the innovations, (samples,).
        signals: name -> (values at the samples, unit).
        owner, time: recording and time of each sample.
        slot: resolution of a map over time, s.
    """

    channels: tuple[str, ...]
    intervals: tuple[tuple[str, float, float], ...]
    states: Mapping[str, Range]
    energy: Array
    signals: Mapping[str, tuple[Array, str]]
    owner: Integers
    time: Array
    slot: float

    @property
    def always(self) -> bool:
        """Whether it is active at nearly all times of every recording."""
        active = sum(end - begin for _, begin, end in self.intervals)
        lasted = sum(float(np.ptp(self.time[self.owner == k])) for k in np.unique(self.owner))
        return active > ALWAYS * lasted


def contribution(answer: LikelihoodFit, without: Array) -> Array:
    """Contribution of a part of a model to the scaled innovations, (samples, outputs): minus those at `without`."""
    q, f = answer.likelihood_problem, answer.filtered
    own = range(len(q.model.states))
    both = run_fixed_gain_filter(q.model, q.problem, np.stack([answer.p, without]), f, own)
    return np.asarray((both[1] - both[0]) / np.sqrt(f.variances[0]))


def region(
    answer: LikelihoodFit,
    mismatch: Array,
    done: Array,
    recordings: tuple[Recording, ...],
    within: Mapping[str, tuple[float, float]] = NOWHERE,
) -> Region:
    """When something is active, and the ranges of the states in which its mismatch lies.

    Args:
        answer: of the model whose states are used.
        mismatch: scaled innovations, (samples, outputs).
        done: its activity at each sample, relative to its largest in the recording, (samples,).
        recordings: to fit.
        within: ranges of signals that its law singles out, in the model's units, in place of those of the mismatch.
    """
    problem = answer.likelihood_problem.problem
    by_output = np.nansum(np.where(np.isfinite(mismatch), mismatch, 0.0) ** 2, axis=0)
    outputs = answer.likelihood_problem.model.outputs
    channels = tuple(
        port.role
        for port, e in zip(outputs, by_output, strict=True)
        if e > 0.2 * max(by_output.max(), 1e-300)
    )
    energy = np.nansum(np.where(np.isfinite(mismatch), mismatch, 0.0) ** 2, axis=1)
    owner = np.repeat(problem.recording, problem.counts + 1)
    signals = _signals(answer, owner, recordings[0])
    states = {
        name: _inside(within[name], values, energy, unit, _per_unit(name, recordings[0]))
        if name in within
        else _range(values, energy, unit)
        for name, (values, unit) in signals.items()
    }
    window = window_seconds(float(np.median(problem.dt)), float(np.ptp(problem.time)))
    intervals = _intervals(done > WORKS, owner, problem.time, recordings, SLOT * window)
    return Region(channels, intervals, states, energy, signals, owner, problem.time, SLOT * window)


def informative_ranges(states: Mapping[str, Range], always: tuple[str, ...]) -> dict[str, Range]:
    """The ranges of the signals in `always`, then those with clearly more of the mismatch than of the samples."""
    ranked = sorted(states.items(), key=lambda item: -item[1].share / max(item[1].occupancy, 1e-9))
    sharp = [(name, r) for name, r in ranked if r.informative][:3]
    return {name: states[name] for name in always if name in states} | dict(sharp)


def _per_unit(role: str, recording: Recording) -> float:
    return recording.channels[role].per_unit if role in recording.channels else 1.0


def _signals(answer: LikelihoodFit, owner: Integers, recording: Recording) -> dict[str, tuple[Array, str]]:
    """States and inputs at the samples; a command in the unit in which it was recorded."""
    q, X = answer.likelihood_problem, answer.filtered.states[0]
    found: dict[str, tuple[Array, str]] = {}
    for i, state in enumerate(q.model.states):
        if state.unit != "1" and "." not in state.name:
            found[state.name] = (X[:, i], state.unit)
    for j, port in enumerate(q.model.inputs):
        if port in q.model.recorded:
            size = _per_unit(port.role, recording)
            values = size * q.problem.inputs[:, j]
            unit = port.unit if size == 1.0 else recording.channels[port.role].recorded_unit
            found[port.role] = (values, unit)
            rate = np.diff(values, prepend=values[:1])
            rate[np.diff(owner, prepend=owner[:1]) != 0] = 0.0
            found[f"{port.role}_rate"] = (rate / q.problem.dt, f"{unit}/s")
    found["time"] = (q.problem.time, "s")
    return found


def _inside(limits: tuple[float, float], values: Array, energy: Array, unit: str, size: float) -> Range:
    """A range that a law states, as far as the signal was there, with its shares."""
    good = np.isfinite(values)
    v, e = values[good], energy[good]
    if not len(v):
        return Range(float("nan"), float("nan"), unit, 0.0, 1.0)
    low, high = (float(np.clip(size * one, v.min(), v.max())) for one in limits)
    there = (v >= low) & (v <= high)
    share = float(e[there].sum() / max(float(e.sum()), 1e-300))
    return Range(low, high, unit, share, float(np.mean(there)), by_law=True)


def _range(values: Array, energy: Array, unit: str) -> Range:
    """The range with the fewest samples that contains `COVER` of the energy."""
    good = np.isfinite(values)
    v, e = values[good], energy[good]
    total = float(e.sum())
    if not len(v) or total <= 0.0:
        return Range(float("nan"), float("nan"), unit, 0.0, 1.0)
    values, which = np.unique(v, return_inverse=True)
    held = np.r_[0.0, np.cumsum(np.bincount(which, weights=e))] / total
    count = np.r_[0.0, np.cumsum(np.bincount(which))] / len(v)
    # From each value up to the first one with which the range holds enough.
    last = np.searchsorted(held, held + COVER - 1e-12)
    enough = np.flatnonzero(last < len(held))
    a = int(enough[np.argmin(count[last[enough]] - count[enough])])
    b = int(last[a])
    return Range(
        float(values[a]), float(values[b - 1]), unit, float(held[b] - held[a]), float(count[b] - count[a])
    )


def _intervals(
    works: Booleans, owner: Integers, time: Array, recordings: tuple[Recording, ...], gap: float
) -> tuple[tuple[str, float, float], ...]:
    """Runs of samples, each up to the one after it; those less than `gap` apart are one."""
    found = []
    for number, recording in enumerate(recordings):
        mine = owner == number
        t, at = time[mine], np.flatnonzero(works[mine])
        for run in np.split(at, np.flatnonzero(np.diff(t[at]) > gap) + 1) if len(at) else []:
            begin, end = t[run[0]], t[min(run[-1] + 1, len(t) - 1)]
            if end > begin:
                found.append((recording.name, round(float(begin), 6), round(float(end), 6)))
    return tuple(found)


def running_rms(signal: Array, problem: Problem) -> Array:
    """The root mean square of an estimated signal over a slot around each sample, of its recording: it is noisy."""
    step = float(np.median(problem.dt))
    box = np.ones(max(round(SLOT * window_seconds(step, float(np.ptp(problem.time))) / step), 1))
    power = np.where(np.isfinite(signal), signal, 0.0) ** 2
    owner = np.repeat(problem.recording, problem.counts + 1)
    for number in np.unique(owner):
        mine = owner == number
        there = np.convolve(np.ones(mine.sum()), box)[len(box) // 2 :][: mine.sum()]
        power[mine] = np.convolve(power[mine], box)[len(box) // 2 :][: mine.sum()] / there
    return np.asarray(np.sqrt(power))
