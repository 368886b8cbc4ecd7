"""States of an enriched model at the nodes of a plainer one: the common ones kept, the effects' own carried along."""

from __future__ import annotations

import numpy as np

from optid.core.model import Array, Model
from optid.core.simulation import simulate
from optid.fit.problem import Problem


def carried(
    model: Model, parameters: Array, problem: Problem, plain: Model, X: Array, tolerance: float
) -> tuple[Array, Array, Array]:
    """Simulate windows in sequence: at each node the plain model's states are set, the others go on.

    Args:
        model: the enriched model; its states include the plain model's.
        parameters: (runs, parameters), one set per run.
        problem: windows; its inputs are the enriched model's.
        plain: the model whose node states are known.
        X: its states at the nodes, (windows, plain states).
        tolerance: of the simulation.

    Returns:
        Node states (runs, windows, states), outputs (runs, samples, outputs) and ends of the windows
        (runs, windows, states).
    """
    runs, nx = len(parameters), len(model.states)
    names = [state.name for state in model.states]
    common = [names.index(state.name) for state in plain.states]
    starts = np.array([np.asarray(model.start(p)[0]).ravel() for p in parameters])
    nodes, ends = np.empty((runs, len(X), nx)), np.empty((runs, len(X), nx))
    Y = np.full((runs, len(problem.time), len(model.outputs)), np.nan)
    state = starts
    for w, (begin, count) in enumerate(zip(problem.begins, problem.counts, strict=True)):
        if w == 0 or problem.closed[w - 1]:
            state = starts
        nodes[:, w] = state
        nodes[:, w, common] = X[w]
        part = simulate(
            model, parameters, nodes[:, w], problem.dt, problem.inputs,
            first=np.array([begin]), intervals=int(count), tolerance=tolerance,
        )  # fmt: skip
        last = count + 1 if problem.closed[w] else count
        Y[:, begin : begin + last] = part.outputs[:, :last]
        state = ends[:, w] = part.states[:, count]
    return nodes, Y, ends
