"""Free runs of a model over held commands: many windows and many parameter sets at a time."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from optid.core import kernel
from optid.core.jit import compiled_runs
from optid.core.model import Array, Model
from optid.core.threads import parallel_for

# Local error of a step as a share of each state's usual size: positions within 0.01 micrometre of Radau (tests).
TOLERANCE = 2e-8


class Carried(NamedTuple):
    """Windows in sequence: `nodes` and `ends` (runs, windows, states), `outputs` (runs, samples, outputs), SI."""

    nodes: Array
    ends: Array
    outputs: Array


class Windows(Protocol):
    """Windows over held inputs; those of a segment follow one another."""

    @property
    def dt(self) -> Array:
        """Time from each sample to the next, s, (samples,)."""

    @property
    def inputs(self) -> Array:
        """Held from each sample to the next, (samples, inputs)."""

    @property
    def begins(self) -> NDArray[np.int64]:
        """First sample of each window."""

    @property
    def counts(self) -> NDArray[np.int64]:
        """Intervals of each window."""

    @property
    def closed(self) -> NDArray[np.bool_]:
        """It is the last one of its segment."""


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
    """Simulate held inputs; a run that diverges ends in NaN.

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
    machine, sizes = compiled_runs(model), tolerance * model.scales
    dt, inputs = np.ascontiguousarray(dt, dtype=float), np.ascontiguousarray(inputs, dtype=float)
    given = (starts, counts, X0, P, dt, inputs, sizes, X, Y)
    parallel_for(runs, lambda a, b: machine.run(kernel.simulate, a, b, *given))
    return Runs(X, Y)


def carry(
    model: Model,
    parameters: Array,
    start: Array,
    windows: Windows,
    known: Array,
    tolerance: float = TOLERANCE,
) -> Carried:
    """Simulate windows in sequence: at each node the known states are set, the others are carried over.

    Args:
        model: the plant.
        parameters: one set per run, (runs, parameters), SI.
        start: states at the head of every segment, (runs, states).
        windows: where they begin, how long they are, and the inputs held over them.
        known: states at the nodes, (windows, states); NaN where a state is carried over.
        tolerance: local error as a share of each state's scale.
    """
    P, X0 = (np.ascontiguousarray(np.atleast_2d(a), dtype=float) for a in (parameters, start))
    X = np.empty((len(P), *known.shape))
    ends, Y = np.empty_like(X), np.full((len(P), len(windows.dt), len(model.outputs)), np.nan)
    given = (windows.begins, windows.counts, windows.closed, np.ascontiguousarray(known), X0, P)
    found = (windows.dt, windows.inputs, tolerance * model.scales, X, Y, ends)
    machine = compiled_runs(model)
    parallel_for(len(P), lambda a, b: machine.run(kernel.carry, a, b, *given, *found))
    return Carried(X, ends, Y)
