"""First guess of the states at the nodes: measured ones from the data, the others simulated."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from optid.core.model import Array, Model
from optid.core.simulation import carry
from optid.core.threads import one_at_a_time

if TYPE_CHECKING:
    from optid.estimation.problem import Problem

HALF_WIDTH = 12  # samples on either side of a node that a local parabola smooths


@lru_cache(maxsize=64)
@one_at_a_time
def measured_states(model: Model) -> tuple[Mapping[int, int], Mapping[int, int]]:
    """States measured directly (state -> output), and those that are the rate of such a state."""
    x, u = ca.SX.sym("x", len(model.states)), ca.SX.sym("u", len(model.inputs))
    p = _usual_parameters(model)
    y, f = model.sensors(x, u, p), model.rates(x, u, p)
    direct = {i: o for o in range(y.numel()) for i in range(x.numel()) if ca.is_equal(y[o], x[i])}
    rates = {j: o for i, o in direct.items() for j in range(x.numel()) if ca.is_equal(f[i], x[j])}
    return direct, {j: o for j, o in rates.items() if j not in direct}


@lru_cache(maxsize=64)
@one_at_a_time
def _states_behind_sensors(model: Model) -> tuple[tuple[int, int, float, float], ...]:
    """States that outputs show through a sensor with errors: (state, output, slope, output where the state is 0).

    Of every output that is no state itself, the state by which it may vary most, if it is linear in that.
    """
    direct, _ = measured_states(model)
    x, u = ca.SX.sym("x", len(model.states)), ca.DM.zeros(len(model.inputs))
    p = _usual_parameters(model)
    y = model.sensors(x, u, p)
    mean, spread = (np.array(each).ravel() for each in model.start(p))
    at, slopes = (np.array(each) for each in ca.Function("h", [x], [y, ca.jacobian(y, x)])(mean))
    found = []
    for o in set(range(y.numel())).difference(direct.values()):
        i = int(np.argmax(np.abs(np.nan_to_num(slopes[o])) * spread))
        linear = not ca.depends_on(ca.jacobian(y[o], x[i]), x)
        if linear and i not in direct and slopes[o, i] != 0.0 and np.isfinite(at[o]):
            found.append((i, o, float(slopes[o, i]), float(at[o, 0] - slopes[o, i] * mean[i])))
    return tuple(found)


def _usual_parameters(model: Model) -> ca.DM:
    return ca.DM([q.typical if q.default is None else q.default for q in model.parameters])


def guess(model: Model, problem: Problem, p: Array) -> Array:
    """States at the nodes, shape (windows, states)."""
    direct, rates = measured_states(model)
    mean = np.array(model.start(p)[0]).ravel()
    known = np.full((len(problem.begins), len(model.states)), np.nan)
    for o in {*direct.values(), *rates.values()}:
        level, slope = _local(problem, o)
        for states, values in ((direct, level), (rates, slope)):
            for i in (i for i, k in states.items() if k == o):
                known[:, i] = values
    for i, o, per_state, zero in _states_behind_sensors(model):
        known[:, i] = (_local(problem, o)[0] - zero) / per_state
    return np.asarray(carry(model, p, mean, problem, known, problem.tolerance).nodes[0])


def _local(problem: Problem, output: int) -> tuple[Array, Array]:
    """Level and slope of an output at the nodes, from parabolas through their neighbours of the same segment.

    A straight line through up to six known neighbours; NaN where there are less than three.
    """
    begins, tails = problem.begins, np.flatnonzero(problem.closed)
    segment = np.searchsorted(tails, np.arange(len(begins)))
    stop = (begins + problem.counts)[tails][segment]
    head = begins[np.r_[0, tails[:-1] + 1]][segment]
    rows = begins[:, None] + np.arange(-HALF_WIDTH, HALF_WIDTH + 1)
    inside = (rows >= head[:, None]) & (rows <= stop[:, None])
    rows = np.where(inside, rows, begins[:, None])
    t, y = problem.time[rows] - problem.time[begins][:, None], problem.measured[rows, output]
    known = inside & np.isfinite(y)
    number = known.sum(axis=1)
    scale = np.abs(t).max(axis=1, keepdims=True)
    powers = (t / scale)[:, :, None] ** np.arange(3) * known[:, :, None]
    powers[number <= 6, :, 2] = 0.0
    normal = np.einsum("wni,wnj->wij", powers, powers)
    normal[number <= 6, 2, 2] = 1.0
    normal[number < 3] = np.eye(3)
    right = np.einsum("wni,wn->wi", powers, np.where(known, y, 0.0))
    c = np.linalg.solve(normal, right[:, :, None])[:, :2, 0]
    c[number < 3] = np.nan
    return c[:, 0], c[:, 1] / scale[:, 0]
