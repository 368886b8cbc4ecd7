"""A linear step from a model along every branch of every effect: a score test with a line search.

A simulation of an effect at its usual size, with the fixed gains of the model's quiet filter, shows its change of the
windows' errors, and how much of these the effect in any strength and all other parameters explain linearly. Effects may
be inserted several at a time, all but one at their nulls: that is one model to compile.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from optid.core.model import Array
from optid.diagnosis.fitted import FittedModel
from optid.diagnosis.problem import DiagnosisProblem
from optid.effects.effect import Effect
from optid.estimation.fixed_gain import LOST, Residuals, innovations
from optid.estimation.likelihood import Filtered, huber, huber_weight
from optid.estimation.likelihood_point import LikelihoodProblem
from optid.estimation.multistep import quiet_filter
from optid.estimation.problem import Booleans
from optid.rigs.rig import with_effects

LITTLE = 0.1  # of a direction, or of a wave's height: step of its finite difference
FARTHEST = 3.0  # times the usual size: largest strength along a branch
ROUNDS = 2  # iterations of reweighting in a linear fit
UNSEEN = 0.01  # sd: a smaller change is the integrator's


@dataclass(frozen=True, eq=False)
class LinearStep:
    """The result of a linear step: an effect's parameters by own name, and the predicted loss."""

    effect: Effect
    values: Mapping[str, float]
    loss: float


@dataclass(frozen=True, eq=False)
class Branch:
    """The step along a branch, ``None`` without information, and how visible its effect is."""

    best: LinearStep | None
    effect: Effect
    visible: float


@dataclass(frozen=True, eq=False)
class Origin:
    """The point of linearisation: parameters by name, the filter there, the windows' errors and their slopes."""

    values: Mapping[str, float]
    held: Filtered
    errors: Array
    slopes: Array  # (rows, free)
    per_window: float  # rows
    room: tuple[Array, Array]  # to the bounds, in typical sizes, (free,) each


def origin_at(
    q: LikelihoodProblem,
    p: Array,
    resets: Booleans,
    per_window: float,
    level: float,
) -> Origin | None:
    """The model's errors and their slopes; ``None`` where the simulation diverges."""
    held = quiet_filter(q, p, level)
    if held is None:
        return None
    free = list(q.free)
    residuals = Residuals(q, p, q.model, held, resets=resets)
    errors, slopes = (
        each[: -len(free)] for each in residuals.linearised(residuals.start)
    )  # without the priors
    values = dict(zip((one.name for one in q.model.parameters), p.tolist(), strict=True))
    room = ((q.low - p[free]) / q.typical, (q.high - p[free]) / q.typical)
    return Origin(values, held, errors, slopes, per_window, room)


def branches_of(
    current: FittedModel,
    problem: DiagnosisProblem,
    origin: Origin,
    resets: Booleans,
    effects: Sequence[Effect],
) -> list[list[Branch]]:
    """Every branch of some effects, at the strength that explains most; one list per effect."""
    q = problem.likelihood_problem(with_effects(current.rig, effects))
    points = [_scored_points(current, effect) for effect in effects]
    each = [effect.qualified(point) for effect, some in zip(effects, points, strict=True) for point in some]
    P = np.array([q.at({**origin.values, **values}) for values in ({}, *each)])
    here, *seen = innovations(q, P, current.likelihood_problem.model, origin.held, resets=resets)
    found, rest = [], np.array(seen) - here
    for effect, some in zip(effects, points, strict=True):
        changes, rest = rest[: len(some)], rest[len(some) :]
        found.append((_combined_branch if effect.ways else _separate_branches)(origin, effect, some, changes))
    return found


def _scored_points(current: FittedModel, effect: Effect) -> list[dict[str, float]]:
    """Parameters at which an effect is simulated: a little along each direction, or at the start of each branch."""
    null = effect.at_null()
    if effect.ways:
        return [
            {**null, **{name: null[name] + LITTLE * by for name, by in way.items()}} for way in effect.ways
        ]
    return [{**null, **one} for one in effect.tries(*_missed(current))]


def _separate_branches(
    origin: Origin, effect: Effect, points: Sequence[Mapping[str, float]], changes: Array
) -> list[Branch]:
    """Each branch by itself; changes of the windows' errors at its point, (points, rows)."""
    null, found = effect.at_null(), []
    for point, change in zip(points, changes, strict=True):
        seen = _visible(origin, change)
        if seen < UNSEEN:
            found.append(Branch(None, effect, 0.0))
            continue
        visible = seen / effect.size(point)
        step, loss = _explained(origin, change[:, None], 0.0)
        strength = step[-1]
        if not strength > 0.0:
            found.append(Branch(None, effect, visible))
            continue
        scaled = {
            name: null[name] + strength * (value - null[name]) if name in effect.strength else value
            for name, value in point.items()
        }
        found.append(Branch(LinearStep(effect, scaled, loss), effect, visible))
    return found


def _combined_branch(
    origin: Origin, effect: Effect, points: Sequence[Mapping[str, float]], changes: Array
) -> list[Branch]:
    """An effect that starts at its null, along all of its directions at once."""
    visible = max(
        _visible(origin, one) / max(effect.size(point), 1e-12)
        for one, point in zip(changes, points, strict=True)
    )
    step, loss = _explained(origin, changes.T / LITTLE, -FARTHEST)
    own = dict(effect.at_null())
    for strength, way in zip(step[-len(effect.ways) :], effect.ways, strict=True):
        for name, by in way.items():
            own[name] += strength * by
    return [Branch(LinearStep(effect, own, loss), effect, visible)]


def _missed(current: FittedModel) -> tuple[list[Array], float]:
    """The quiet filter's prediction errors of the first output in every stretch of data, and the sampling time."""
    problem, missed = current.likelihood_problem.problem, current.fit.filtered.innovations[0][:, 0]
    stretches = zip(problem.begins, problem.counts, strict=True)
    return [missed[first : first + count + 1] for first, count in stretches], float(np.median(problem.dt))


def linear_loss_without_effect(origin: Origin) -> float:
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
        weight = huber_weight(z)
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
