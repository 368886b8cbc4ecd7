"""Which wave at a site would explain what a model misses: a spectrum over time or over a state, by score tests.

Both quadratures of every frequency are simulated under the gains of a filter, as a screen does with effects, and held
against its innovations. A spectrum of an estimated signal would show lines over time as well, but hardly over a
position, which comes and goes at its own pace and takes every slow drift along.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from optid.core.model import Array
from optid.diagnose.lead import Ground
from optid.diagnose.screen import grown
from optid.effects.wave import TIME, Wave
from optid.fit.likelihood import FAR
from optid.fit.problem import Integers
from optid.fit.steering import innovations

FINE = 2  # steps of the grid to a line's width
SLOWEST = 2.0  # periods within the range, at least
NUDGE = 0.1  # height at which a wave is tried
BATCH = 32  # frequencies simulated together


class Line(NamedTuple):
    """A wave that explains some of what a model misses.

    Attributes:
        gain: by which the sum of squared, scaled innovations would fall.
        repeats: periods by the SI unit of what it follows.
        height, phase: of the wave; over time, root mean square and mean over the recordings.
    """

    gain: float
    repeats: float
    height: float
    phase: float


def loudest(ground: Ground, wave: Wave, along: Array, fastest: float, at: float | None = None) -> Line | None:
    """The wave that explains most; ``None`` where there is room for none.

    Over time each recording may have its own phase.

    Args:
        ground: where the model stands that misses something, and the filter whose gains hold; when the time of its
            recordings is over, what was seen has to do.
        wave: to try, of any frequency.
        along: values of what it follows, (samples,).
        fastest: periods by the unit of that, at most.
        at: so many periods by the unit alone, instead of a search.
    """
    rows = np.nonzero(np.isfinite(ground.guide.filtered.innovations[0]))[0]
    problem = ground.guide.question.problem
    owner = np.repeat(problem.recording, problem.counts + 1)[rows]
    pieces = [np.flatnonzero(owner == one) for one in np.unique(owner)]
    span = max(float(np.ptp(along[rows[piece]])) for piece in pieces)
    if not span > 0.0:
        return None
    if wave.along != TIME:
        pieces = [np.arange(len(rows))]
    grid, found = np.arange(SLOWEST / span, fastest, 1.0 / (FINE * span)), []
    if at is not None:
        grid = np.array([at])
    for first in range(0, len(grid), BATCH):
        if ground.data.over:
            break
        found += _explained(ground, wave, grid[first : first + BATCH], pieces)
    return max(found, default=None)


def _explained(ground: Ground, wave: Wave, some: Array, pieces: Sequence[Integers]) -> list[Line]:
    """What waves of some frequencies would explain.

    The free parameters have their linear say first; innovations that are far off count as Huber has it.
    """
    question, guide = ground.data.question(grown(ground.rig, wave), ground.plain), ground.guide
    points = [
        {**wave.of_height(height), "repeats": float(repeats), "phase": phase}
        for height, repeats, phase in [
            (0.0, some[0], 0.0),
            *((NUDGE, one, turned) for one in some for turned in (0.0, math.pi / 2)),
        ]
    ]
    P = np.array([ground.placed(question, wave.qualified(point)) for point in points])
    here, *there = innovations(question, P, guide.question.model, guide.filtered)
    root = np.sqrt(np.minimum(1.0, FAR / np.maximum(np.abs(here), 1e-12)))
    basis = np.linalg.qr(ground.slopes * root[:, None])[0]
    rest, *changes = (
        column - basis @ (basis.T @ column)
        for column in (here * root, *((one - here) * root for one in there))
    )
    found = []
    for repeats, both in zip(some.tolist(), zip(changes[::2], changes[1::2], strict=True), strict=True):
        columns, gain, steps = np.stack(both, axis=1), 0.0, []
        for piece in pieces:
            step = np.linalg.lstsq(columns[piece], -rest[piece], rcond=1e-9)[0]
            gain += float(np.sum(rest[piece] ** 2) - np.sum((rest[piece] + columns[piece] @ step) ** 2))
            steps.append(step)
        height = NUDGE * float(np.sqrt(np.mean(np.sum(np.square(steps), axis=1))))
        phase = math.atan2(*np.sum(steps, axis=0)[::-1])
        found.append(Line(gain, repeats, height, phase))
    return found
