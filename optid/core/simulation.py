"""Free runs of a model over held commands: many windows and many parameter sets at a time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from optid.core.compiled import compiled, spread
from optid.core.model import Array, Model

# Local error of a step as a share of each state's usual size: positions within 0.01 micrometre of Radau (tests).
TOLERANCE = 2e-8


class Runs(NamedTuple):
    """Free runs: `states` (runs, samples, states) and `outputs` (runs, samples, outputs), in SI units."""

    states: Array
    outputs: Array


def simulate(
    model: Model,
    parameters: Array,
    start: Array,
    dt: Array,
    inputs: Array,
    *,
    first: NDArray[np.int64] | None = None,
    intervals: int | None = None,
    tolerance: float = TOLERANCE,
) -> Runs:
    """Simulate held inputs; a run that leaves the numbers ends in NaN.

    Args:
        model: the plant.
        parameters: one set (parameters,) or one per run (runs, parameters), in SI units.
        start: start states, (states,) or (runs, states).
        dt: time from each sample to the next, s, shape (samples,); the last one may be anything.
        inputs: (samples, inputs), held from each sample to the next.
        first: sample at which each run starts, shape (runs,); 0 when absent.
        intervals: number of intervals of every run; up to the last sample when absent.
        tolerance: local error as a share of each state's scale.
    """
    starts = np.atleast_1d(np.zeros(1, dtype=np.int64) if first is None else first).astype(np.int64)
    runs = max(len(starts), len(np.atleast_2d(start)), len(np.atleast_2d(parameters)))
    starts = np.ascontiguousarray(np.broadcast_to(starts, runs))
    longest = len(inputs) - 1 if intervals is None else intervals
    counts = np.minimum(longest, len(inputs) - 1 - starts)
    X0 = np.ascontiguousarray(np.broadcast_to(start, (runs, len(model.states))), dtype=float)
    P = np.ascontiguousarray(np.broadcast_to(parameters, (runs, len(model.parameters))), dtype=float)
    X = np.full((runs, longest + 1, len(model.states)), np.nan)
    Y = np.full((runs, longest + 1, len(model.outputs)), np.nan)
    kernel, sizes = compiled(model), tolerance * model.scales
    dt, inputs = np.ascontiguousarray(dt, dtype=float), np.ascontiguousarray(inputs, dtype=float)
    spread(runs, lambda a, b: kernel.simulate(a, b, starts, counts, X0, P, dt, inputs, sizes, X, Y))
    return Runs(X, Y)
