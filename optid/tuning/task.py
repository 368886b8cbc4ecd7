"""The task of a tuning, and the cost of gains."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property

import numpy as np

from optid.core.model import Array
from optid.errors import InputError
from optid.pid.controller import Settings
from optid.tuning.bench import Bench
from optid.tuning.criterion import Criterion
from optid.tuning.loop import ClosedLoop
from optid.tuning.margins import COARSE, Frequencies, Required, excess, look
from optid.tuning.plant import Plant, behind
from optid.tuning.scenarios import Episode

STRICTER = 1.0002
EARLY = 0.5  # of the allowed hunting, from which it is penalised on a bench: no model equals the axis
REFUSED = 1e20  # cost of gains that violate the requirements, increasing with the violation


class Aggregation(Enum):
    """How the costs on several plants are combined."""

    WORST = "the largest one"
    MEAN = "their mean plus their standard deviation"


@dataclass(frozen=True, eq=False)
class Task:
    """The loop to tune.

    Attributes:
        plants: the model first, then others drawn from its covariance, if any.
        episodes: scenarios of the loop.
        settings: of the controller: limits, rate, and the model's sample time.
        criterion: minimised.
        required: margins to keep on every plant.
        over: how several plants count.
        bench: a physical model included in the tuning: one more plant, without margins.
        bench_alone: whether the physical model alone judges performance, and the plants the margins.
        hunting: peak to peak of the output at rest beyond which gains hunt, output's unit: their cost is multiplied by
            the ratio, on a bench that of each episode, from half of it on and squared. A hard limit would favour gains
            that never arrive, as those are at rest as well.
    """

    plants: tuple[Plant, ...]
    episodes: tuple[Episode, ...]
    settings: Settings
    criterion: Criterion = field(default_factory=Criterion)
    required: Required = field(default_factory=Required)
    over: Aggregation = Aggregation.WORST
    bench: Bench | None = None
    bench_alone: bool = False
    hunting: float = math.inf

    def __post_init__(self) -> None:
        if not self.plants:
            raise InputError("none", field="plants", expected="at least the model")
        rest = min(max(0.0, self.settings.low), self.settings.high)
        if rest != 0.0:
            raise InputError(
                f"{self.settings.low:g} to {self.settings.high:g}",
                field="limits",
                expected="a range that contains 0, the command at which the model is at rest",
            )
        self.closed_loop  # noqa: B018  # complains now, not in the middle of a search

    @property
    def plant(self) -> Plant:
        """The model itself."""
        return self.plants[0]

    @cached_property
    def command_size(self) -> float:
        """Range of the command; without limits, that of the steps at the ultimate gain."""
        span = self.settings.high - self.settings.low
        if math.isfinite(span):
            return span
        from optid.tuning.ultimate import ultimate

        size = max((episode.size for episode in self.episodes), default=0.0)
        return max(2.0 * abs(ultimate(self.plant).gain) * size, 1e-300) if size else 1.0

    @cached_property
    def closed_loop(self) -> ClosedLoop:
        """The simulated loop."""
        return ClosedLoop(self.plants, self.episodes, self.criterion, self.settings.vector, self.command_size)

    @cached_property
    def loops(self) -> tuple[Plant, ...]:
        """The plants with the controller's notch, for linear analysis; the model itself first."""
        return tuple(behind(plant, self.settings.notch) for plant in self.plants)

    @cached_property
    def grids(self) -> tuple[Frequencies, ...]:
        """For the margins on each plant."""
        return tuple(Frequencies.of(plant, COARSE) for plant in self.loops)

    @cached_property
    def bounds(self) -> Array:
        """The requirements, slightly stricter, so that they also hold between the grid's frequencies."""
        return np.asarray(
            self.required.bounds * np.array([1.0, 1.0 / STRICTER, STRICTER, STRICTER, STRICTER])
        )

    def margins(self, gains: Array) -> list[Array]:
        """Of one set of gains on every plant, in the order of `optid.tuning.margins`, as the search sees them."""
        return [look(p, grid, gains) for p, grid in zip(self.loops, self.grids, strict=True)]

    def missed(self, gains: Array) -> Array:
        """Violation of the requirements by gains (n, GAINS), shape (n,); 0 where they are met.

        With a simulation with friction and no required margin, the linear loop need not be stable.
        """
        if self.bench_alone and self.required == Required():
            return np.zeros(len(np.atleast_2d(gains)))
        each = [excess(p, grid, self.bounds, gains) for p, grid in zip(self.loops, self.grids, strict=True)]
        return np.asarray(np.max(each, axis=0))

    def fitness(self, gains: Array, bar: Array | None = None) -> Array:
        """The minimised number, for gains (n, GAINS); very large where a margin is violated.

        Args:
            gains: candidates.
            bar: cost that each must undercut, shape (n,): one that cannot is not run on the bench and gets some value
                above it.
        """
        gains = np.ascontiguousarray(np.atleast_2d(gains))
        missed = self.missed(gains)
        value, kept = REFUSED * (1.0 + missed), missed <= 0.0
        if np.any(kept):
            value[kept] = self._performance(gains[kept], None if bar is None else bar[kept])
        return value

    def _performance(self, gains: Array, bar: Array | None) -> Array:
        """Of gains that keep the margins, shape (n,): the cost, more if they hunt."""
        if self.bench is not None and self.bench_alone:
            return np.asarray(np.minimum(self._on_bench(gains, bar, EARLY * self.hunting), REFUSED))
        each, swings = self.closed_loop.judged(gains)
        if self.bench is not None:
            each = np.column_stack([each, self._tried(gains, each, bar)])
        cost = self.together(each) * np.maximum(swings.max(axis=1) / self.hunting, 1.0)
        return np.asarray(np.minimum(cost, REFUSED))

    def _on_bench(self, gains: Array, bar: Array | None, rest: float = math.inf) -> Array:
        assert self.bench is not None
        return self.bench.judged(gains, self.settings, self.criterion, self.command_size, bar, rest)[0]

    def _tried(self, gains: Array, each: Array, bar: Array | None) -> Array:
        """Costs on the bench, shape (n,); for gains that are already too bad, the worst of the other costs."""
        found: Array = np.asarray(each.max(axis=1))
        open_still = found < (np.inf if bar is None or self.over is not Aggregation.WORST else bar)
        if np.any(open_still):
            found[open_still] = self._on_bench(gains[open_still], None)
        return found

    def together(self, costs: Array) -> Array:
        """Of costs (n, plants): shape (n,)."""
        if costs.shape[1] == 1:
            return np.asarray(costs[:, 0])
        if self.over is Aggregation.WORST:
            return np.asarray(costs.max(axis=1))
        with np.errstate(invalid="ignore", over="ignore"):
            value = costs.mean(axis=1) + costs.std(axis=1)
        return np.where(np.isfinite(value), value, np.inf)
