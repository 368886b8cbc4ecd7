"""What gains are worth: one run on the identified model (or elsewhere), in numbers that a table can hold."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from optid.core.model import Array
from optid.tuning.demand import Episode
from optid.tuning.measure import Measure

SETTLED = 0.02  # of a step: the band in which the output must stay


@dataclass(frozen=True, eq=False)
class Response:
    """One episode as it went: arrays of shape (samples,), NaN after the output has run away.

    Attributes:
        episode: what was asked.
        output, command: what came.
        measures: ITAE, IAE, ITSE, ISE by lower-case name; infinite after a run-away.
        overshoot: largest share of a step; 0 where no step is asked.
        settled: s after which the last step's error stays within 2 % of it; infinite if it does not.
        travel: sum of all moves of the command, command's unit.
    """

    episode: Episode
    output: Array
    command: Array
    measures: dict[str, float]
    overshoot: float
    settled: float
    travel: float

    @property
    def bounded(self) -> bool:
        """It did not run away."""
        return bool(np.isfinite(self.output[-1]))


def response(episode: Episode, output: Array, command: Array, sample_time: float) -> Response:
    """Measure one run."""
    error = np.abs(episode.reference - output)
    measures, sane = {}, bool(np.isfinite(output).all())
    for measure in Measure:
        weights = measure.weights(episode.clock, sample_time)
        measures[measure.name.lower()] = float(np.sum(weights * error**measure.power)) if sane else math.inf
    beyond = float(np.max((output - episode.reference) * episode.rise)) if sane else math.inf
    travel = float(np.sum(np.abs(np.diff(command, prepend=0.0)))) if sane else math.inf
    return Response(
        episode, output, command, measures, max(beyond, 0.0), _settled(episode, error, sample_time), travel
    )


def _settled(episode: Episode, error: Array, sample_time: float) -> float:
    last = episode.rise[-1]
    if last == 0.0 or not np.isfinite(error).all():
        return math.inf
    outside = np.flatnonzero(error * abs(last) > SETTLED)
    if outside.size and outside[-1] == error.size - 1:
        return math.inf
    at = int(outside[-1]) + 1 if outside.size else 0
    return float(episode.clock[at])
