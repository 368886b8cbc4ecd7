"""The exact gradient of a tuning's cost: one sample of the loop, differentiated by CasADi and run as machine code.

CasADi carries the state's derivatives along the same sample (`optid.tuning.loop_code`; forward mode, exact through
limits and anti-windup as far as they can be differentiated), and LLVM makes machine code of both. A thousand samples
take a fraction of a millisecond, where CasADi's own virtual machine takes tens.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from optid.core.kernel import at, call
from optid.core.model import Array
from optid.core.threads import one_at_a_time
from optid.pid.pid_step import GAINS, MEMORY, PER_STEP, RESOLUTION
from optid.tuning.loop_code import MachineCode, closed_loop_sample, initial_state, single_loop_code
from optid.tuning.machine import compiled
from optid.tuning.search import PLACES
from optid.tuning.task import Aggregation, Task


@one_at_a_time
def forward_sensitivities(
    order: int, squared_error: bool, settings: Sequence[float], free: Sequence[str]
) -> ca.Function:
    """A sample with derivatives: (w, g, plant, s, e) -> w afterwards.

    w holds x of `closed_loop_sample` and behind it its derivative to each free gain; the rest is as there.
    """
    plain = closed_loop_sample(order, squared_error, settings)
    count, n = plain.nnz_in(0), len(free)
    w, *others = (ca.SX.sym(f"i{k}", plain.nnz_in(k) * (1 if k else 1 + n)) for k in range(plain.n_in()))
    x, g = w[:count], others[0]
    after = plain(x, *others)
    slopes = [
        ca.jtimes(
            after,
            ca.vertcat(x, g),
            ca.vertcat(w[count * (1 + j) : count * (2 + j)], ca.DM.eye(GAINS)[:, PLACES[name]]),
        )
        for j, name in enumerate(free)
    ]
    return ca.Function("sample", [w, *others], [ca.cse(ca.densify(ca.vertcat(after, *slopes)))])


@lru_cache(maxsize=32)
def _sensitivity_code(
    order: int, squared_error: bool, settings: tuple[float, ...], free: tuple[str, ...]
) -> MachineCode:
    return single_loop_code(forward_sensitivities(order, squared_error, settings, free))


class Gradient:
    """Cost and its derivative to the free gains.

    Args:
        task: without a bench, whose physics has no gradient here, and without a user's own cost.
        free: names of the gains.
    """

    def __init__(self, task: Task, free: tuple[str, ...]) -> None:
        assert task.criterion.own is None
        self._task, self._free = task, free
        loop = task.closed_loop
        # The resolution of the command is left out: its steps would hide every slope.
        self._settings = loop.settings.copy()
        self._settings[[RESOLUTION - GAINS, PER_STEP - GAINS]] = 0.0
        self._code = _sensitivity_code(loop.order, loop.squared_error, tuple(self._settings.tolist()), free)

    def __call__(self, gains: Array) -> tuple[float, Array]:
        """Of one set of gains (GAINS,): cost, and derivatives (free,); not finite where the loop diverges."""
        with np.errstate(over="ignore", invalid="ignore"):
            each = [self._plant(gains, k) for k in range(len(self._task.plants))]
            costs, slopes = np.array([one[0] for one in each]), np.array([one[1] for one in each])
            if len(each) == 1 or self._task.over is Aggregation.WORST:
                top = int(np.argmax(costs))
                return float(costs[top]), slopes[top]
            away, spread = costs - costs.mean(), max(float(costs.std()), 1e-300)
            tilt = away @ (slopes - slopes.mean(0)) / (len(each) * spread)
            return float(costs.mean() + costs.std()), slopes.mean(0) + tilt

    def _plant(self, gains: Array, plant: int) -> tuple[float, Array]:
        task, criterion, n = self._task, self._task.criterion, len(self._free)
        loop, rest = task.closed_loop, min(max(0.0, task.settings.low), task.settings.high)
        start = initial_state(loop.order, rest, 1).ravel()
        value, slope = 0.0, np.zeros(n)
        for e, episode in enumerate(task.episodes):
            w = np.concatenate([start, np.zeros(n * start.size)])
            given = np.ascontiguousarray(gains), loop.plant_rows[plant], self._settings
            _run(self._code.place, w, *given, np.ascontiguousarray(loop.episode_rows[e].T))
            rows = w.reshape(1 + n, -1)[:, loop.order + MEMORY :]
            measure, travel, overshoot = rows[0, :3]
            travel_slopes = rows[1:, 1] / task.command_size
            factor = 1.0 + criterion.effort * travel / task.command_size + criterion.overshoot * overshoot
            value += episode.weight * measure * factor
            slope += episode.weight * (
                rows[1:, 0] * factor
                + measure * (criterion.effort * travel_slopes + criterion.overshoot * rows[1:, 2])
            )
        return float(value), slope


@compiled
def _run(place: Any, w: Any, g: Any, plant: Any, s: Any, columns: Any) -> None:
    for n in range(columns.shape[0]):
        call(place, (at(w, 0), at(g, 0), at(plant, 0), at(s, 0), at(columns[n], 0)))
