"""The likelihood of recordings under a model with process noise: the innovations of a filter and their variances.

Stochastic grey-box modelling (Kristensen, Madsen and Jorgensen, Automatica 40, 2004): the states follow the model
and a random walk on top, whose size per second is estimated with the parameters. A model that lacks physics needs more
process noise, so that its errors count as noise when parameters and effects are judged.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from optid.core import ddf2 as kernel
from optid.core.jit import compiled_lanes
from optid.core.llvm_simd import LANES
from optid.core.model import Array, Model
from optid.core.threads import one_at_a_time, parallel_for
from optid.estimation.problem import Booleans, Integers, Problem

BESIDE = 0.01  # of what process noise adds to a state from sample to sample: local error of the integration, if larger
SHARE = 50.0  # times the tolerance of dimensionless states: those of a contact forget an error within microns of motion
QUIET = 1e-4  # process noise of states without an estimated level, in usual sizes per sqrt(s)
WHOLE = math.inf  # s: the windows of a problem to be filtered are whole segments
FAR = 6.0  # innovations beyond so many sd count linearly


class Start(NamedTuple):
    """Prior of the states at the start of segments, SI.

    Attributes:
        mean: (sets, segments, states).
        covariance: (sets, segments, states, states).
    """

    mean: Array
    covariance: Array

    @classmethod
    def apart(cls, mean: Array, sd: Array) -> Start:
        """A prior with independent states and sd in the shape of `mean`."""
        return cls(mean, sd[..., None] ** 2 * np.eye(sd.shape[-1]))

    def times(self, sets: int) -> Start:
        """The same prior for several sets."""
        return Start(np.repeat(self.mean, sets, axis=0), np.repeat(self.covariance, sets, axis=0))


@dataclass(frozen=True, eq=False)
class Filtered:
    """The result of a filter run, for each parameter set.

    Attributes:
        innovations: measured minus one-step prediction, (sets, samples, outputs); NaN where nothing is measured.
        variances: of the innovations.
        states: one-step predictions, (sets, samples, states), SI; empty unless kept.
        gains: (sets, samples, outputs, states), SI; empty unless kept.
        covariances: of the states, (sets, samples, states, states), SI; empty unless requested.
        tolerance: tolerance of the integration, (sets, states), SI.
    """

    innovations: Array
    variances: Array
    states: Array
    gains: Array
    covariances: Array
    tolerance: Array


@dataclass(frozen=True, eq=False)
class Noise:
    """Measurement noise and process noise.

    Attributes:
        measurement: variance of each output, (outputs,).
        groups: states that share a level of process noise, by unit.
        levels: log of that noise, in usual sizes of the states per sqrt(s), (groups,).
    """

    measurement: Array
    groups: tuple[tuple[int, ...], ...]
    levels: Array

    def spectrum(self, states: int) -> Array:
        """Variance of each state's random walk per second, in squared usual sizes, (states,)."""
        Q = np.full(states, QUIET**2)
        for group, level in zip(self.groups, self.levels, strict=True):
            Q[list(group)] = np.exp(2.0 * level)
        return Q


@one_at_a_time
def noisy_states(model: Model, plain: Sequence[str] | None = None) -> tuple[tuple[int, ...], ...]:
    """States with process noise, grouped by unit: those whose equations may lack physics.

    Excluded are positions whose rate is another state, dimensionless states, and those not in `plain`.
    """
    x, u, p = (ca.SX.sym(n, k) for n, k in zip("xup", _sizes(model), strict=True))
    rates = model.rates(x, u, p)
    groups: dict[str, list[int]] = {}
    for i, state in enumerate(model.states):
        kinematic = any(ca.is_equal(rates[i], x[j]) for j in range(x.numel()))
        if kinematic or state.unit == "1" or (plain is not None and state.name not in plain):
            continue
        groups.setdefault(state.unit, []).append(i)
    return tuple(tuple(group) for group in groups.values())


def _sizes(model: Model) -> tuple[int, int, int]:
    return len(model.states), len(model.inputs), len(model.parameters)


def run_filter(
    model: Model,
    problem: Problem,
    P: Array,
    Q: Array,
    R: Array,
    *,
    keep: bool = False,
    covariances: bool = False,
    only: Sequence[int] | None = None,
    start: Start | None = None,
) -> Filtered:
    """Filter segments with all parameter sets, in parallel.

    Args:
        model: the plant.
        problem: with one window per segment.
        P: (sets, parameters); `Q` (sets, states) and `R` (sets, outputs) as `filtered` takes them.
        keep: also return states and gains.
        covariances: also return those of the states.
        only: segments to use; all if absent; NaN in the others.
        start: prior at their start; the model's own if absent.
    """
    sets = len(P)
    segments = np.array(range(len(problem.begins)) if only is None else only)
    nx, N, ny = len(model.states), len(problem.time), len(model.outputs)
    M0, C0 = (np.ascontiguousarray(a) for a in start or start_of(model, P, len(problem.begins)))
    E, V = np.full((sets, N, ny), np.nan), np.full((sets, N, ny), np.nan)
    X = np.zeros((sets, N, nx) if keep else (1, 1, 1))
    K = np.zeros((sets, N, ny, nx) if keep else (1, 1, 1, 1))
    S = np.zeros((sets if covariances else 0, N, nx, nx))
    of_set, of_segment = (np.ascontiguousarray(a) for a in _runs(sets, segments))
    machine, linear = compiled_lanes(model), linear_outputs(model)
    given = (of_set, of_segment, problem.begins, problem.counts, M0, C0, P, Q, R, problem.dt, problem.inputs)
    noise = np.sqrt(Q * float(np.median(problem.dt))) * model.scales
    tolerance = np.ascontiguousarray(np.maximum(_tolerance(model, problem), BESIDE * noise))
    found = (problem.measured, linear, tolerance, model.scales, keep, E, V, X, K, S)
    parallel_for(len(of_set), lambda a, b: machine.run(kernel.filtered, a, b, *given, *found))
    return Filtered(E, V, X, K, S, tolerance)


@lru_cache(maxsize=128)
@one_at_a_time
def linear_outputs(model: Model) -> Booleans:
    """Outputs whose slopes by the states depend on parameters alone, (outputs,)."""
    x, u, p = (ca.SX.sym(n, k) for n, k in zip("xup", _sizes(model), strict=True))
    slopes = ca.jacobian(model.sensors(x, u, p), x)
    return np.array([not ca.depends_on(slopes[o, :], ca.vertcat(x, u)) for o in range(len(model.outputs))])


def run_fixed_gain_filter(
    model: Model,
    problem: Problem,
    P: Array,
    guide: Filtered,
    common: Sequence[int],
    *,
    start: Array | None = None,
    only: Sequence[int] | None = None,
    resets: Booleans | None = None,
) -> Array:
    """Innovations (sets, samples, outputs) of models corrected with another filter's gains.

    Args:
        model: its states contain those of the guide's model at the indices `common`.
        problem: with one window per segment.
        P: (sets, parameters).
        guide: the filter, with gains kept, sets = 1.
        common: see `model`.
        start: states at the start of every segment, (sets, states), or of each, (sets, segments, states); the model's
            own if absent.
        only: segments to use; all if absent; NaN in the others.
        resets: samples from which predictions start, (samples,): each predicts up to the next one, instead of one step.
    """
    sets = len(P)
    segments = np.array(range(len(problem.begins)) if only is None else only)
    resets = np.ones(len(problem.time), dtype=np.bool_) if resets is None else resets
    M0 = _starts(model, P)[0] if start is None else start
    M0 = M0 if M0.ndim == 3 else np.repeat(M0[:, None], len(problem.begins), axis=1)
    M0 = np.ascontiguousarray(M0)
    E = np.full((sets, len(problem.time), len(model.outputs)), np.nan)
    first_set, of_segment = _runs(-(-sets // LANES), segments)
    machine, places = compiled_lanes(model), np.array(common, dtype=np.int64)
    tolerance = _tolerance(model, problem)
    tolerance[places] = guide.tolerance[0]
    given = (LANES * first_set, of_segment, problem.begins, problem.counts, M0, P, guide.gains[0], places)
    data = (problem.dt, problem.inputs, problem.measured, tolerance, resets, E)
    parallel_for(len(first_set), lambda a, b: machine.run(kernel.fixed_gain, a, b, *given, *data))
    return E


def run_windows(model: Model, problem: Problem, p: Array, starts: Array, only: Sequence[int]) -> Array:
    """Outputs of free runs over some of a problem's windows, (sets, samples, outputs); NaN elsewhere.

    A run that diverges ends in NaN.

    Args:
        model: the plant.
        problem: with the windows.
        p: all parameters, (parameters,).
        starts: states where windows begin, (sets, windows, states).
        only: these windows.
    """
    ny, N = len(model.outputs), len(problem.time)
    blind = replace(problem, measured=np.zeros((N, ny)), counts=problem.counts - ~problem.closed)
    nothing = np.empty((1, 0, ny))
    tolerance = _tolerance(model, problem)[None, :0]
    free = Filtered(nothing, nothing, nothing, np.zeros((1, N, ny, 0)), nothing, tolerance)
    P = np.tile(p, (len(starts), 1))
    E = run_fixed_gain_filter(model, blind, P, free, (), start=starts, only=only)
    return np.where(np.isfinite(E), -E, np.nan)


def _tolerance(model: Model, problem: Problem) -> Array:
    shares = [SHARE if state.unit == "1" else 1.0 for state in model.states]
    return np.asarray(problem.tolerance * model.scales * shares)


def _starts(model: Model, P: Array) -> tuple[Array, Array]:
    both = model.start.map(len(P))(P.T)
    mean, sd = (np.array(a).T for a in both)
    return mean, sd


def start_of(model: Model, P: Array, segments: int) -> Start:
    """A model's prior of the states at the start of a segment, for each parameter set."""
    mean, sd = _starts(model, P)
    return Start.apart(np.repeat(mean[:, None], segments, axis=1), np.repeat(sd[:, None], segments, axis=1))


def _runs(sets: int, segments: Integers) -> tuple[Array, Array]:
    s, g = np.meshgrid(np.arange(sets), segments, indexing="ij")
    return np.ascontiguousarray(s.ravel()), np.ascontiguousarray(g.ravel())


def deviance(innovations: Array, variances: Array) -> Array:
    """-2 log likelihood of each sample, (..., samples), up to a constant; 0 where nothing is measured.

    Innovations beyond `FAR` sd count linearly, as from heavier tails than the normal's.
    """
    loss = huber(innovations / np.sqrt(variances)) + np.log(variances)
    return np.asarray(np.nansum(np.where(np.isnan(innovations), 0.0, loss), axis=-1))


def huber(z: Array) -> Array:
    """Squares of deviations in sd, linear beyond `FAR` (Huber, Ann. Math. Statist. 35, 1964)."""
    far = np.abs(z)
    return np.asarray(np.where(far > FAR, FAR * (2.0 * far - FAR), far**2))


def huber_weight(z: Array) -> Array:
    """Weights with which least squares minimise `huber`: 1, less beyond `FAR` sd."""
    return np.minimum(1.0, FAR / np.maximum(np.abs(z), 1e-12))


def broyden_formula(J: Array, step: Array, change: Array, weight: Array) -> Array:
    """Jacobians (..., coordinates) after a step with this change (Broyden, Math. Comput. 19, 1965).

    `weight` is the metric, (coordinates,): in that of the curvature's diagonal all coordinates have equal weight.
    """
    along = weight * step
    return J + (change - J @ step)[..., None] * (along / (step @ along))
