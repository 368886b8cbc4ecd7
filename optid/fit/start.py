"""First guess of the states at the nodes: what is measured from the data, the rest carried by the model."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np

from optid.core.model import Array, Model
from optid.core.simulation import simulate
from optid.fit.problem import Problem

HALF_WIDTH = 12  # samples on either side of a node that a local parabola smooths


def measured_states(model: Model) -> tuple[Mapping[int, int], Mapping[int, int]]:
    """States an output shows directly (state -> output), and those that are the rate of such a one."""
    x, u = ca.SX.sym("x", len(model.states)), ca.SX.sym("u", len(model.inputs))
    p = ca.DM([q.typical if q.default is None else q.default for q in model.parameters])
    y, f = model.sensors(x, u, p), model.rates(x, u, p)
    direct = {i: o for o in range(y.numel()) for i in range(x.numel()) if ca.is_equal(y[o], x[i])}
    rates = {j: o for i, o in direct.items() for j in range(x.numel()) if ca.is_equal(f[i], x[j])}
    return direct, {j: o for j, o in rates.items() if j not in direct}


def guess(model: Model, problem: Problem, p: Array) -> Array:
    """States at the nodes, shape (windows, states)."""
    direct, rates = measured_states(model)
    mean = np.array(model.start(p)[0]).ravel()
    X = np.tile(mean, (len(problem.begins), 1))
    for w, begin in enumerate(problem.begins):
        first = w == 0 or problem.closed[w - 1]
        if not first:
            run = simulate(
                model, p, X[w - 1], problem.dt, problem.inputs,
                first=problem.begins[w - 1 : w], intervals=int(problem.counts[w - 1]), tolerance=1e-4,
            )  # fmt: skip
            end = run.states[0, problem.counts[w - 1]]
            X[w] = np.where(np.isfinite(end), end, X[w - 1])
        for o in {*direct.values(), *rates.values()}:
            level, slope = _local(problem, o, int(begin), w)
            if np.isfinite(level):
                X[w, [i for i, k in direct.items() if k == o]] = level
                X[w, [i for i, k in rates.items() if k == o]] = slope
    return X


def _local(problem: Problem, output: int, at: int, window: int) -> tuple[float, float]:
    """Level and slope of an output at a sample, from a parabola through its neighbours of the same segment."""
    heads = np.flatnonzero(np.r_[True, problem.closed[:-1]])
    head = problem.begins[heads[heads <= window][-1]]
    tails = np.flatnonzero(problem.closed)
    tail = tails[tails >= window][0]
    stop = problem.begins[tail] + problem.counts[tail] + 1
    span = slice(max(head, at - HALF_WIDTH), min(stop, at + HALF_WIDTH + 1))
    t, y = problem.time[span] - problem.time[at], problem.measured[span, output]
    known = np.isfinite(y)
    if known.sum() < 3:
        return np.nan, np.nan
    degree = 2 if known.sum() > 6 else 1
    c = np.polynomial.polynomial.polyfit(t[known], y[known], degree)
    return float(c[0]), float(c[1])
