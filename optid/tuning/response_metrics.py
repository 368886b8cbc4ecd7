"""Scores of gains: one run on the identified model (or another), in numbers for a table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from optid.core.model import Array
from optid.tuning.integral_criteria import Measure
from optid.tuning.scenarios import Episode

SETTLED = 0.02  # of a step: the band in which the output must stay


@dataclass(frozen=True, eq=False)
class Response:
    """The response in one episode: arrays of shape (samples,), NaN after the output has diverged.

    Attributes:
        episode: the simulated scenario.
        output, command: trajectories.
        measures: ITAE, IAE, ITSE, ISE by lower-case name; infinite after a divergence.
        overshoot: largest share of a step; 0 where no step is asked.
        settled: s after which the last step's error stays within 2 % of it; infinite if it does not.
        travel: total variation of the command, command's unit.
        hunting: peak to peak of the output while it should be at rest, output's unit; 0 where it need not be.
    """

    episode: Episode
    output: Array
    command: Array
    measures: dict[str, float]
    overshoot: float
    settled: float
    travel: float
    hunting: float = 0.0

    @property
    def bounded(self) -> bool:
        """Whether it did not diverge."""
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
    still = output[episode.rest :] if episode.rest < output.size else np.zeros(1)
    hunting = float(np.ptp(still)) if sane else math.inf
    return Response(
        episode,
        output,
        command,
        measures,
        max(beyond, 0.0),
        _settled(episode, error, sample_time),
        travel,
        hunting,
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


@dataclass(frozen=True)
class SizeRow:
    """Scores of steps of one size: means over their runs, but the largest hunting and overshoot.

    Attributes:
        size: of the step, output's unit.
        itae_over_size: s2.
        overshoot: share of the step.
        settling_time: s, infinite where a run did not settle.
        hunting: peak to peak at rest, output's unit.
    """

    size: float
    itae_over_size: float
    overshoot: float
    settling_time: float
    hunting: float


def _nominal(run: Response) -> float:
    return run.episode.nominal or float(run.episode.reference[-1])


def by_size(runs: Sequence[Response]) -> list[SizeRow]:
    """One row for each size of step among the runs, the largest first."""
    steps = [
        run for run in runs if np.all(run.episode.reference == run.episode.reference[-1]) and run.episode.size
    ]
    sizes = dict.fromkeys(_nominal(run) for run in steps)
    rows = []
    for size in sorted(sizes, key=lambda s: (-abs(s), -s)):
        own = [run for run in steps if _nominal(run) == size]
        rows.append(
            SizeRow(
                size,
                float(np.mean([run.measures["itae"] / run.episode.size for run in own])),
                max(run.overshoot for run in own),
                float(np.mean([run.settled for run in own])),
                max(run.hunting for run in own),
            )
        )
    return rows
