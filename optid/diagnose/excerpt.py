"""Long recordings brought down to the stretches that tell most, so that a diagnosis ends in minutes.

A search fits dozens of models to all samples, and what many minutes of alike motion add to the first is little. The
stretches in which the base model misses most are taken, for what is missing may be at work in one minute only, and as
many at even distances, for what the base parameters say elsewhere. They begin in fast motion, which soon shows the
states that nothing measures: a filter that begins at rest may be misled about them for seconds. Recordings held out
stay whole.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from optid.core.model import Array
from optid.core.recording import Recording
from optid.diagnose.beginning import swiftness
from optid.fit.likelihood import WHOLE, huber, run_filter
from optid.fit.prediction import horizon
from optid.fit.problem import pose
from optid.fit.scoring import approach, question_of
from optid.rigs.rigfile import Rig

ENOUGH = 40_000  # samples in all: three recordings of 12 s at a kilohertz stay whole
STRETCH = 8  # windows that are kept or left out together, more or less
AROUND = 2  # windows to either side of an even edge in which the fastest motion is looked for

Stretch = tuple[int, int, int]  # recording, first row, row after the last


def excerpts(rig: Rig, recordings: Sequence[Recording], enough: int = ENOUGH) -> tuple[Recording, ...]:
    """The recordings, or of more than `enough` samples those stretches that tell most.

    What is left out leaves gaps. A recording keeps its first stretch: its clock counts from there.

    Raises:
        SolveError: the model cannot be simulated at the rig file's values.
    """
    if sum(map(len, recordings)) <= enough:
        return tuple(recordings)
    outputs = [port.role for port in rig.model.outputs]
    every = [stretch for n, one in enumerate(recordings) for stretch in _stretches(n, one, outputs)]
    count = max(len(recordings), round(len(every) * enough / sum(map(len, recordings))))
    firsts = [k for k, (n, _, _) in enumerate(every) if k == 0 or every[k - 1][0] != n]
    even = _evenly(every, firsts, count)
    loss = _losses(rig, recordings, every, _kept(recordings, [every[k] for k in even]))
    others = sorted((k for k in range(len(every)) if k not in firsts), key=lambda k: -loss[k])
    telling = [*firsts, *others[: (count - len(firsts)) // 2]]
    return _kept(recordings, [every[k] for k in _evenly(every, telling, count)])


def _stretches(number: int, recording: Recording, outputs: Sequence[str]) -> list[Stretch]:
    """All rows of a recording, in stretches of about the same length that begin in fast motion."""
    window = horizon(recording.interval) / recording.interval
    parts = max(1, round(len(recording) / (STRETCH * window)))
    even = np.linspace(0, len(recording), parts + 1).astype(int).tolist()
    swift, reach = swiftness(recording, outputs), round(AROUND * window)
    inner = [edge - reach + int(np.argmax(swift[edge - reach : edge + reach])) for edge in even[1:-1]]
    return [(number, first, end) for first, end in itertools.pairwise([0, *inner, len(recording)])]


def _evenly(every: Sequence[Stretch], kept: Sequence[int], count: int) -> list[int]:
    """Those kept, and of the others as many as make up the count, at even distances."""
    others = [k for k in range(len(every)) if k not in set(kept)]
    more = max(0, min(count - len(kept), len(others)))
    places = (np.arange(more) + 0.5) * len(others) / max(more, 1)
    return sorted([*kept, *(others[int(place)] for place in places)])


def _kept(recordings: Sequence[Recording], stretches: Sequence[Stretch]) -> tuple[Recording, ...]:
    """The recordings with these stretches of them only."""
    found = []
    for n, recording in enumerate(recordings):
        rows = np.concatenate([np.arange(a, b) for number, a, b in stretches if number == n])
        found.append(recording.taken(rows))
    return tuple(found)


def _losses(
    rig: Rig, recordings: Sequence[Recording], every: Sequence[Stretch], some: Sequence[Recording]
) -> Array:
    """What a base model that was brought near by `some` misses in each stretch, by Huber's weights."""
    near = approach(question_of(rig, pose(rig.model, some, WHOLE)), rig.model.vector(rig.parameters))
    problem = pose(rig.model, recordings, WHOLE)
    f = run_filter(
        rig.model,
        problem,
        near.p[None],
        near.noise.spectrum(len(rig.model.states))[None],
        near.noise.measurement[None],
    )
    loss = np.nansum(huber(f.innovations[0] / np.sqrt(f.variances[0])), axis=1)
    owner = np.repeat(problem.recording, problem.counts + 1)
    spans = [(n, recordings[n].time[a], recordings[n].time[b - 1]) for n, a, b in every]
    return np.array(
        [loss[(owner == n) & (problem.time >= a) & (problem.time <= b)].sum() for n, a, b in spans]
    )
