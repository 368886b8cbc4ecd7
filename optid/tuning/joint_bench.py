"""Several simulations of the same axis at once: gains must be good on all of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from optid.core.model import Array
from optid.pid.controller import Settings
from optid.tuning.bench import Bench
from optid.tuning.criterion import Criterion


class JointBench(Bench):
    """The cost is the mean over simulations of the same axis, the hunting the largest.

    No simulation meets an axis at rest exactly, where gains hunt or do not; two that were made in different ways
    seldom err alike.

    Args:
        benches: each with its own episodes.
    """

    def __init__(self, benches: Sequence[Bench]) -> None:
        share = 1.0 / len(benches)
        super().__init__(
            tuple(replace(one, weight=share * one.weight) for each in benches for one in each.episodes)
        )
        self._benches = tuple(benches)

    def judged(
        self,
        gains: Array,
        settings: Settings,
        criterion: Criterion,
        command_size: float,
        bar: Array | None = None,
        rest: float = math.inf,
    ) -> tuple[Array, Array]:
        """As for any bench; a candidate that exceeds its bar on the first simulations does not run on the others."""
        count, total, hunting = len(self._benches), np.zeros(len(gains)), np.zeros(len(gains))
        for one in self._benches:
            left = None if bar is None else count * bar - total
            cost, swing = one.judged(gains, settings, criterion, command_size, left, rest)
            total, hunting = total + cost, np.maximum(hunting, swing)
        return total / count, hunting

    def only(self, chosen: Sequence[int]) -> JointBench:
        """The same with some of their episodes, by number."""
        parts, first = [], 0
        for one in self._benches:
            last = first + len(one.episodes)
            parts.append(one.only([e - first for e in chosen if first <= e < last]))
            first = last
        return JointBench(parts)
