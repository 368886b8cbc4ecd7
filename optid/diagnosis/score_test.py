"""A linear step from a model along every branch of every effect: a score test with a line search.

A simulation of an effect at its usual size, with the fixed gains of the model's quiet filter, shows its change of the
windows' errors, and how much of these the effect in any strength and all other parameters explain linearly.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from optid.core.model import Array
from optid.diagnosis.fitted import FittedModel
from optid.diagnosis.problem import DiagnosisProblem, with_effect
from optid.effects.effect import Effect
from optid.estimation.fixed_gain import innovations
from optid.estimation.likelihood import FAR, Filtered, huber
from optid.estimation.likelihood_point import NUDGES, LikelihoodProblem
from optid.estimation.multistep import quiet_filter
from optid.estimation.problem import Booleans

LITTLE = 0.1  # of a direction: step of its finite difference
FARTHEST = 3.0  # times the usual size: largest strength along a branch
ROUNDS = 2  # iterations of reweighting in a linear fit
LOST = 30.0  # sd: larger changes are clipped to it
FEWEST = 0.02  # share of the usual size below which a branch is ignored


@dataclass(frozen=True, eq=False)
class LinearStep:
    """The result of a linear step: an effect's parameters, the predicted loss, and a step of the other parameters.

    The step is in typical sizes, (free,).
    """

    effect: Effect
    likelihood_problem: LikelihoodProblem
    p: Array
    loss: float
    step: Array


@dataclass(frozen=True, eq=False)
class Branch:
    """The step along a branch, ``None`` without information, and how visible its effect is."""

    best: LinearStep | None
    effect: Effect
    visible: float


@dataclass(frozen=True, eq=False)
class Origin:
    """The point of linearisation: parameters by name, the filter there, the windows' errors and their slopes.

    `free` are the names of the fitted parameters, `typical` their sizes.
    """

    values: Mapping[str, float]
    free: tuple[str, ...]
    typical: Array
    held: Filtered
    errors: Array
    slopes: Array  # (rows, free)
    per_window: float  # rows
    room: tuple[Array, Array]  # to the bounds, in typical sizes, (free,) each


def origin_at(
    q: LikelihoodProblem,
    p: Array,
    only: Sequence[int],
    resets: Booleans,
    per_window: float,
    level: float,
) -> Origin | None:
    """The model's errors and their slopes over some segments; ``None`` where the simulation diverges."""
    held = quiet_filter(q, p, only, level)
    if held is None:
        return None
    free = list(q.free)
    P = np.tile(p, (len(free) + 1, 1))
    steps = np.where(p[free] + NUDGES[1] * q.typical > q.high, -NUDGES[1], NUDGES[1])
    P[range(1, len(P)), free] += steps * q.typical
    here, *others = innovations(q, P, q.model, held, only, resets)
    values = dict(zip((one.name for one in q.model.parameters), p.tolist(), strict=True))
    room = ((q.low - p[free]) / q.typical, (q.high - p[free]) / q.typical)
    names = tuple(q.model.parameters[i].name for i in free)
    slopes = ((np.array(others) - here) / steps[:, None]).T
    return Origin(values, names, q.typical, held, here, slopes, per_window, room)


def branches_of(
    current: FittedModel,
    problem: DiagnosisProblem,
    origin: Origin,
    only: Sequence[int],
    resets: Booleans,
    effect: Effect,
) -> list[Branch]:
    """Every branch of an effect, at the strength that explains most."""
    q = problem.likelihood_problem(with_effect(current.rig, effect))
    null = effect.at_null()
    if effect.ways:
        return [_from_ways(current, origin, only, resets, effect, q)]
    points = [{**null, **one} for one in effect.tries(*_missed(current))]
    P = np.array([q.at({**origin.values, **effect.qualified(point)}) for point in points])
    seen = innovations(q, P, current.likelihood_problem.model, origin.held, only, resets)
    found = []
    for point, z in zip(points, seen, strict=True):
        change = z - origin.errors
        visible = _visible(origin, change) / effect.size(point)
        step, loss = _explained(origin, change[:, None], 0.0)
        strength = step[-1]
        if strength < FEWEST:
            found.append(Branch(None, effect, visible))
            continue
        scaled = {
            name: null[name] + strength * (value - null[name]) if name in effect.strength else value
            for name, value in point.items()
        }
        p = q.at({**origin.values, **effect.qualified(scaled)})
        found.append(Branch(LinearStep(effect, q, p, loss, step[:-1]), effect, visible))
    return found


def _from_ways(
    current: FittedModel,
    origin: Origin,
    only: Sequence[int],
    resets: Booleans,
    effect: Effect,
    q: LikelihoodProblem,
) -> Branch:
    """An effect that starts at its null, along all of its directions at once."""
    null = effect.at_null()
    turns = [{**null, **{name: null[name] + LITTLE * by for name, by in way.items()}} for way in effect.ways]
    P = np.array([q.at({**origin.values, **effect.qualified(turn)}) for turn in turns])
    seen = innovations(q, P, current.likelihood_problem.model, origin.held, only, resets)
    changes = (seen - origin.errors).T / LITTLE
    visible = max(
        _visible(origin, LITTLE * one) / max(effect.size(turn), 1e-12)
        for one, turn in zip(changes.T, turns, strict=True)
    )
    step, loss = _explained(origin, changes, -FARTHEST)
    own, count = dict(null), len(origin.free)
    for strength, way in zip(step[count:], effect.ways, strict=True):
        for name, by in way.items():
            own[name] += strength * by
    p = q.at({**origin.values, **effect.qualified(own)})
    return Branch(LinearStep(effect, q, p, loss, step[:count]), effect, visible)


def _missed(current: FittedModel) -> tuple[list[Array], float]:
    """The quiet filter's prediction errors of the first output in every stretch of data, and the sampling time."""
    problem, missed = current.likelihood_problem.problem, current.fit.filtered.innovations[0][:, 0]
    stretches = zip(problem.begins, problem.counts, strict=True)
    return [missed[first : first + count + 1] for first, count in stretches], float(np.median(problem.dt))


def loss_of_own_step(origin: Origin) -> float:
    """The loss that a linear step of the model's own parameters predicts."""
    return _explained(origin, np.empty((len(origin.errors), 0)), 0.0)[1]


def _explained(origin: Origin, changes: Array, least: float) -> tuple[Array, float]:
    """Linear least squares over parameters within bounds and shares of changes (rows, some), and the loss.

    Returns the parameters' steps in typical sizes and then the shares, (free + some,).
    """
    slopes, z, some = np.column_stack([origin.slopes, changes]), origin.errors, changes.shape[1]
    low = np.append(origin.room[0], np.full(some, least))
    high = np.append(origin.room[1], np.full(some, FARTHEST))
    taken, best = np.zeros(slopes.shape[1]), math.inf
    for _ in range(ROUNDS):
        weight = np.minimum(1.0, FAR / np.maximum(np.abs(z), 1e-12))
        normal = (slopes.T * weight) @ slopes
        size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        values, vectors = np.linalg.eigh(normal / np.outer(size, size))
        root = np.sqrt(np.maximum(values, 1e-9))
        aim = -(vectors.T @ (slopes.T @ (weight * origin.errors) / size)) / root
        step = (
            lsq_linear(
                root[:, None] * vectors.T, aim, (low * size - 1e-12, high * size + 1e-12), method="bvls"
            ).x
            / size
        )
        z = origin.errors + slopes @ step
        loss = 0.5 * float(huber(z).sum())
        if loss < best:
            taken, best = step, loss
    return taken, best


def _visible(origin: Origin, change: Array) -> float:
    """Root of the part of a change in the windows' mean squares that the free parameters cannot compensate."""
    clipped = np.clip(change, -LOST, LOST)
    size = np.maximum(np.linalg.norm(origin.slopes, axis=0), 1e-300)
    unit = origin.slopes / size
    left = clipped - unit @ np.linalg.lstsq(unit.T @ unit, unit.T @ clipped, rcond=1e-9)[0]
    return float(np.sqrt(np.sum(left**2) / origin.per_window))
