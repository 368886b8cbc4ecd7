"""A simulation that judges gains, and another one of the same axis on which they must not hunt."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from optid.core.model import Array
from optid.pid.controller import Settings
from optid.tuning.bench import Bench
from optid.tuning.criterion import Criterion


class GuardedBench(Bench):
    """The cost is that of the judge, and what hunting on the guard adds.

    No simulation meets an axis at rest exactly, where gains hunt or do not; two that were made in different ways
    seldom err alike.

    Args:
        judge: whose cost counts.
        guard: with its own episodes; its cost counts only as far as gains hunt there.
    """

    def __init__(self, judge: Bench, guard: Bench) -> None:
        super().__init__((*judge.episodes, *guard.episodes))
        self._judge, self._guard = judge, guard.against_hunting()

    def judged(
        self,
        gains: Array,
        settings: Settings,
        criterion: Criterion,
        command_size: float,
        bar: Array | None = None,
        rest: float = math.inf,
    ) -> tuple[Array, Array]:
        """As for any bench; a candidate that exceeds its bar with the judge does not run with the guard."""
        cost, hunting = self._judge.judged(gains, settings, criterion, command_size, bar, rest)
        left = None if bar is None else bar - cost
        more, swing = self._guard.judged(gains, settings, criterion, command_size, left, rest)
        return cost + more, np.maximum(hunting, swing)

    def only(self, chosen: Sequence[int]) -> GuardedBench:
        """The same with some of their episodes, by number."""
        first = len(self._judge.episodes)
        judge = self._judge.only([e for e in chosen if e < first])
        return GuardedBench(judge, self._guard.only([e - first for e in chosen if e >= first]))
