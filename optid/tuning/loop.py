"""The closed loop, compiled: the rig's own controller around the identified model, limits and all.

Candidates run several at a time through the same samples (`optid.tuning.loop_code`), one in each lane of a register.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from optid.core.kernel import at, call
from optid.core.llvm_simd import LANES
from optid.core.model import Array
from optid.core.threads import parallel_for
from optid.errors import InputError
from optid.pid import pid_step as memory_layout
from optid.pid.pid_step import GAINS, MEMORY, law
from optid.tuning.criterion import Criterion
from optid.tuning.loop_code import (
    HIGHEST,
    LOAD,
    LOWEST,
    MEASURE,
    NOISE,
    OVERSHOOT,
    REFERENCE,
    SUMS,
    TRAVEL,
    closed_loop_code,
    initial_state,
)
from optid.tuning.machine import compiled
from optid.tuning.plant import Plant
from optid.tuning.scenarios import Episode

HUNTING = 3  # place of the hunting among the parts of a cost
# Of a cost: the measure, travel of the command in units of its range, overshoot as a share of the step, and the
# output's peak to peak while it should be at rest.
PARTS = 4
# Samples that a thread is given at least, of as many loops as there are lanes: half a millisecond of work.
GRAIN = 40_000
ESCAPED = 1e6  # times the reference: an output this far away has diverged, and is not simulated further
_LAST = memory_layout.LAST_COMMAND


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """Plants, episodes and a criterion as arrays, made once and run for many gains.

    Attributes:
        plants: a controller must work with all of them; the first one is the model itself.
        episodes: all of one length.
        criterion: summed over an episode.
        settings: of the controller, as `Settings.vector` gives them.
        command_size: range of the command, the unit of travel.
    """

    plants: tuple[Plant, ...]
    episodes: tuple[Episode, ...]
    criterion: Criterion
    settings: Array
    command_size: float

    def __post_init__(self) -> None:
        lengths = {episode.reference.size for episode in self.episodes}
        if len(lengths) != 1:
            raise InputError(
                f"{sorted(lengths)} samples", field="episodes", expected="one or more, of one length"
            )
        times = {plant.sample_time for plant in self.plants}
        own = float(self.settings[memory_layout.SAMPLE_TIME - GAINS])
        if times != {own}:
            raise InputError(
                f"{own:g} s, the model's is {next(iter(times)):g} s",
                field="sample_time",
                expected="a controller that runs at the model's sample time",
                hint="identify the model at the rate the controller will run at",
            )

    @property
    def order(self) -> int:
        """Of the plants, padded to the largest."""
        return max(plant.a.size for plant in self.plants)

    @property
    def squared_error(self) -> bool:
        """Whether the measure squares the error."""
        return self.criterion.measure.power == 2

    @cached_property
    def plant_rows(self) -> Array:
        """Each plant as `optid.tuning.loop_code` takes it, (plants, 2 order + 2)."""
        pad = self.order
        rows = [np.r_[_padded(p.a, pad), _padded(p.b, pad), p.dead_zone] for p in self.plants]
        return np.array(rows)

    @cached_property
    def episode_rows(self) -> Array:
        """Each episode as `optid.tuning.loop_code` takes it, (episodes, ROWS, samples)."""
        return np.array([self._rows(episode) for episode in self.episodes])

    def _rows(self, one: Episode) -> Array:
        """An episode as the rows of `optid.tuning.loop_code`, (ROWS, samples)."""
        n, T = one.reference.size, self.plants[0].sample_time
        weight = self.criterion.measure.weights(one.clock, T)
        restless = np.where(np.arange(n) < one.rest, np.inf, 0.0)
        return np.array([one.reference, one.load, weight, np.full(n, one.rise), one.noise, restless])

    def parts(self, gains: Array) -> Array:
        """Parts of the cost of gains (candidates, GAINS): shape (candidates, plants, episodes, PARTS)."""
        gains = np.atleast_2d(gains)
        code = closed_loop_code(self.order, self.squared_error, tuple(self.settings.tolist()))
        start = initial_state(self.order, min(max(0.0, self.settings[1]), self.settings[2]), LANES)
        out = np.empty((len(gains), len(self.plants), len(self.episodes), PARTS))

        def run(first: int, last: int) -> None:
            begin, end = LANES * first, min(LANES * last, len(gains))
            rows = self.plant_rows, self.settings, self.episode_rows
            _batch(code.place, gains, rows, start, begin, end, out)

        each = len(self.plants) * len(self.episodes) * self.episode_rows.shape[2]
        with np.errstate(invalid="ignore", over="ignore"):
            parallel_for(-(-len(gains) // LANES), run, max(GRAIN // each, 1))
        out[..., 1] /= self.command_size
        return out

    def costs(self, gains: Array) -> Array:
        """Cost of each candidate by plant, shape (candidates, plants): the weighted sum over the episodes."""
        return self.judged(gains)[0]

    def judged(self, gains: Array) -> tuple[Array, Array]:
        """Of each candidate by plant, shape (candidates, plants): cost, and the largest hunting (output's unit)."""
        weights = np.array([episode.weight for episode in self.episodes])
        parts = self.parts(gains)
        hunting = np.nan_to_num(parts[..., HUNTING], nan=np.inf).max(axis=-1)
        if self.criterion.own is None:
            return np.asarray(self.criterion.combined(parts) @ weights), hunting
        own = [[self._own(g, k) @ weights for k in range(len(self.plants))] for g in np.atleast_2d(gains)]
        return np.array(own), hunting

    def _own(self, gains: Array, plant: int) -> Array:
        assert self.criterion.own is not None
        time: Array = self.plants[0].sample_time * np.arange(float(self.episodes[0].reference.size))
        found = []
        for number, episode in enumerate(self.episodes):
            y, u = self.trace(gains, plant, number)
            with np.errstate(all="ignore"):
                value = (
                    float(self.criterion.own(time, episode.reference - y, u))
                    if np.isfinite(y).all()
                    else np.inf
                )
            found.append(value if np.isfinite(value) else np.inf)
        return np.array(found)

    def trace(self, gains: Array, plant: int = 0, episode: int = 0) -> tuple[Array, Array]:
        """Output and command at every sample, each of shape (samples,); NaN once the output has diverged."""
        row, order = self.plant_rows[plant], self.order
        samples = self.episode_rows.shape[2]
        y, u = np.empty(samples), np.empty(samples)
        given = row[:order], row[order : 2 * order], row[2 * order :]
        _trace(np.r_[gains, self.settings], *given, self.episode_rows[episode], y, u)
        return y, u


def _padded(row: Array, size: int) -> Array:
    return np.pad(row, (0, size - row.size))


@compiled
def _batch(place: Any, gains: Any, rows: Any, start: Any, first: Any, last: Any, out: Any) -> None:
    """Candidates first..last-1; the lanes left over at the end repeat the last one."""
    plants, settings, episodes = rows
    samples, sums = episodes.shape[2], start.shape[0] - SUMS
    x, g = np.empty_like(start), np.empty((GAINS, LANES))
    for group in range(first, last, LANES):
        for lane in range(LANES):
            for i in range(GAINS):
                g[i, lane] = gains[min(group + lane, last - 1), i]
        for k in range(plants.shape[0]):
            for e in range(episodes.shape[0]):
                x[:] = start
                called = (at(x, 0), at(g, 0), at(plants[k], 0), at(settings, 0), at(episodes[e], 0))
                call(place, (*called, float(samples)))
                for lane in range(min(LANES, last - group)):
                    one = out[group + lane, k, e]
                    one[0] = x[sums + MEASURE, lane]
                    one[1] = x[sums + TRAVEL, lane]
                    one[2] = x[sums + OVERSHOOT, lane]
                    one[HUNTING] = max(x[sums + HIGHEST, lane] - x[sums + LOWEST, lane], 0.0)


@compiled
def passed(command: Any, dead: Any) -> Any:
    """The part of a command that passes a dead zone from dead[0] (at most 0) to dead[1] (at least 0)."""
    return command - min(max(command, dead[0]), dead[1])


@compiled
def _trace(s: Any, a: Any, b: Any, dead: Any, episode: Any, y: Any, u: Any) -> None:
    reference, load, noise = episode[REFERENCE], episode[LOAD], episode[NOISE]
    m, z = np.zeros(MEMORY), np.zeros(a.size + 1)
    m[_LAST] = min(max(0.0, s[GAINS + 1]), s[GAINS + 2])
    bound = ESCAPED * (np.max(np.abs(reference)) + np.max(np.abs(load)))
    for n in range(reference.size):
        y[n] = z[0]
        u[n] = law(s, m, reference[n], y[n] + noise[n])
        if not abs(y[n]) <= bound:
            y[n:] = np.nan
            u[n:] = np.nan
            return
        x = passed(u[n] + load[n], dead)
        for i in range(a.size):
            z[i] = z[i + 1] + b[i] * x - a[i] * y[n]
