"""The wave at a site that would explain a model's errors: a spectrum over time or over a state, by score tests.

Both quadratures of every frequency are simulated with the gains of a filter, as in the score test of effects, and
compared with its innovations. A spectrum of the estimated unknown input would show lines over time as well, but hardly
over a position, along which the axis moves unevenly, and where slow drifts enter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from optid.core.model import Array
from optid.diagnosis.fitted import FittedModel
from optid.diagnosis.problem import DiagnosisProblem, with_effect
from optid.diagnosis.score_test import LITTLE
from optid.effects.wave import TIME, Wave
from optid.estimation.fixed_gain import Residuals, innovations
from optid.estimation.likelihood import huber, huber_weight
from optid.estimation.multistep import window_starts
from optid.estimation.problem import Booleans, Integers

FINE = 2  # steps of the grid to a line's width
SLOWEST = 2.0  # periods within the range, at least
BATCH = 32  # frequencies simulated together


class Line(NamedTuple):
    """A wave that explains a part of a model's errors.

    Attributes:
        gain: predicted decrease of the sum of squared, scaled innovations.
        repeats: periods per SI unit of its argument.
        height, phase: of the wave; over time, root mean square and mean over the recordings.
    """

    gain: float
    repeats: float
    height: float
    phase: float


@dataclass(frozen=True, eq=False)
class Linearisation:
    """A fitted model's innovations under the gains of its quiet filter, and their slopes by the free parameters.

    Attributes:
        model: the model.
        problem: the recordings.
        slopes: of the scaled innovations, by free parameters in typical sizes, (measured, free).
    """

    model: FittedModel
    problem: DiagnosisProblem
    slopes: Array

    @classmethod
    def of(cls, model: FittedModel, problem: DiagnosisProblem) -> Self:
        """At the model's parameters."""
        q = model.likelihood_problem
        residuals = Residuals(q, model.p, q.model, model.fit.filtered)
        return cls(
            model, problem, residuals.linearised(residuals.start)[1][: -len(q.free)]
        )  # without the priors


def strongest_sinusoid(
    at: Linearisation, wave: Wave, along: Array, fastest: float, repeats: float | None = None
) -> Line | None:
    """The wave that explains most; ``None`` where the range is too short for any.

    Over time each recording may have its own phase.

    Args:
        at: the fitted model.
        wave: to test, of any frequency.
        along: values of its argument, (samples,).
        fastest: largest number of periods per unit of that.
        repeats: this number of periods per unit only, instead of a search.
    """
    problem = at.model.likelihood_problem.problem
    seen = _seen(at)
    span = max(float(np.ptp(along[seen.rows[seen.owner == one]])) for one in np.unique(seen.owner))
    if not span > 0.0:
        return None
    if repeats is not None:
        return max(_explained(at, wave, np.array([repeats])), default=None)
    grid = np.arange(SLOWEST / span, fastest, 1.0 / (FINE * span))
    over = _worst_recording(at.model, at.problem)
    if len(over) < len(problem.counts) and len(grid) > BATCH:
        # The recording with the largest mismatch shows which of them are worth a test on all recordings.
        rough = sorted(_batches(at, wave, grid, over), reverse=True)[:BATCH]
        grid = np.array(sorted(line.repeats for line in rough))
    return max(_batches(at, wave, grid), default=None)


def _worst_recording(current: FittedModel, problem: DiagnosisProblem) -> list[int]:
    """The segments of the recording with the largest mismatch."""
    q = current.likelihood_problem
    resets = window_starts(q.problem, problem.window)
    (z,) = innovations(q, current.p[None], q.model, current.fit.filtered, resets=resets)
    rows = np.nonzero(np.isfinite(current.fit.filtered.innovations[0]))[0]
    owner = np.repeat(q.problem.recording, q.problem.counts + 1)[rows]
    loss = np.bincount(owner, weights=huber(z))
    return np.flatnonzero(q.problem.recording == int(np.argmax(loss))).tolist()


class _Seen(NamedTuple):
    """The measurements used: sample and recording of each, and their indices among all, (measured,)."""

    rows: Integers
    owner: Integers
    among: Booleans


def _seen(at: Linearisation, only: Sequence[int] | None = None) -> _Seen:
    """The measurements in all segments, or in some."""
    problem = at.model.likelihood_problem.problem
    rows = np.nonzero(np.isfinite(at.model.fit.filtered.innovations[0]))[0]
    segment = np.repeat(np.arange(len(problem.counts)), problem.counts + 1)[rows]
    among = np.ones(len(rows), dtype=np.bool_) if only is None else np.isin(segment, only)
    return _Seen(rows[among], problem.recording[segment[among]], among)


def _batches(at: Linearisation, wave: Wave, grid: Array, only: Sequence[int] | None = None) -> list[Line]:
    found = []
    for first in range(0, len(grid), BATCH):
        if at.problem.budget.is_over:
            break
        found += _explained(at, wave, grid[first : first + BATCH], only)
    return found


def _explained(at: Linearisation, wave: Wave, some: Array, only: Sequence[int] | None = None) -> list[Line]:
    """The part explained by waves of some frequencies, in all segments or in some.

    The free parameters are fitted linearly first; outliers are weighted as in Huber's loss.
    """
    model = at.model
    q = at.problem.likelihood_problem(with_effect(model.rig, wave))
    points = [
        {**wave.of_height(height), "repeats": float(repeats), "phase": phase}
        for height, repeats, phase in [
            (0.0, some[0], 0.0),
            *((LITTLE, one, turned) for one in some for turned in (0.0, math.pi / 2)),
        ]
    ]
    P = np.array([q.at({**model.values, **wave.qualified(point)}) for point in points])
    here, *there = innovations(q, P, model.likelihood_problem.model, model.fit.filtered, only)
    seen = _seen(at, only)
    pieces = [np.flatnonzero(seen.owner == one) for one in np.unique(seen.owner)]
    if wave.along != TIME:
        pieces = [np.arange(len(seen.rows))]
    root = np.sqrt(huber_weight(here))
    basis = np.linalg.qr(at.slopes[seen.among] * root[:, None])[0]
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
        height = LITTLE * float(np.sqrt(np.mean(np.sum(np.square(steps), axis=1))))
        phase = math.atan2(*np.sum(steps, axis=0)[::-1])
        found.append(Line(gain, repeats, height, phase))
    return found
