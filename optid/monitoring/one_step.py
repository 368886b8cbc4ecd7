"""One-step estimates of a fitted model's parameters, and of effects that it lacks, from a few recordings.

A few Gauss-Newton steps lead from the fitted parameters to those of the recordings. There the errors of short windows
are taken under the gains of a filter, and once more with each parameter, and each watched effect, moved a little. A
linear regression on each then gives the change that explains these errors best (a one-step estimate; van der Vaart,
Asymptotic Statistics, 1998, section 5.7). No effect is searched for. Whether a rig has changed is decided elsewhere: a
fleet's nights are compared with each other (`optid.fleet.statistics`), a live session with its commissioning
(`optid.live.commissioning`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from optid.core.model import Array, Model
from optid.core.recording import Recording
from optid.diagnosis.problem import prepare, with_effect
from optid.effects.effect import Effect
from optid.effects.library import admitted
from optid.estimation.fisher_scoring import likelihood_problem
from optid.estimation.fixed_gain import LOST, innovations
from optid.estimation.likelihood import FAR, WHOLE, Filtered, huber_weight
from optid.estimation.likelihood_point import LikelihoodProblem
from optid.estimation.multistep import fit_multistep, window_starts
from optid.estimation.problem import HORIZON, build_problem
from optid.rigs.rig import Freed, Rig

RATE = 500.0  # Hz at most, the rate of a diagnosis
WINDOW = 0.1  # s: short enough for errors to be proportional to their cause
NUDGE = 1e-2  # of a parameter's typical size: step of its finite difference
PART = 0.5  # of an effect's smallest usual size, likewise: a dead band or a play is not linear at its null
CLUSTER = HORIZON  # s: errors nearer to each other than that are not counted as independent
SLIGHT = 1e-6  # of the curvature: directions below it are not determined by the data
LIVELY = 1.0  # level of the filter that still follows where the quiet one diverges: the model sticks, the rig moves
# Turns and steps of the search from the fitted parameters: friction and supply differ from night to night.
TURNS, STEPS = 2, 3
ERROR = "prediction_error"  # quantity: log of the windows' error over the noise

Progress = Callable[[float, str], None]


def silent(share: float, words: str) -> None:
    """Progress that is not shown and never stops."""


@dataclass(frozen=True)
class Quantity:
    """The estimate of one quantity.

    Attributes:
        value: SI.
        sd: from the scatter of the windows.
        unit: of these.
        explained: share of the squared errors that it explains alone.
    """

    value: float
    sd: float
    unit: str
    explained: float = math.nan


@dataclass(frozen=True, eq=False)
class WindowErrors:
    """Windows' errors at the fitted parameters, in sd, their slopes, and which cluster each belongs to."""

    z: Array
    slopes: Array
    cluster: np.ndarray[Any, np.dtype[np.int64]]


def quantities(
    rig: Rig, recordings: Sequence[Recording], watch: Sequence[str], progress: Progress = silent
) -> dict[str, Quantity]:
    """One-step estimates of a fitted rig's parameters and of each watched effect's sizes.

    Parameters
    ----------
    rig : Rig
        fitted.
    recordings : Sequence[Recording]
        read with it.
    watch : Sequence[str]
        names of effects.
    progress : Progress
        as in `night_test`.

    Raises
    ------
    SolveError
        the simulation diverged at the fitted parameters.
    """
    own = _freed_daily(rig)
    rig, thin = prepare(own, recordings, RATE)
    q = likelihood_problem(rig, build_problem(rig.model, thin, WHOLE), rig.model)
    start = q.model.vector(rig.parameters)
    near = fit_multistep(q, start, WINDOW, turns=TURNS, steps=STEPS, level=LIVELY, most=TURNS)
    p, guide = near.p, near.filtered
    errors = _errors(q, p, guide)
    asked = {one.name for one in rig.freed}
    found = {ERROR: Quantity(0.5 * math.log(float(np.mean(np.minimum(errors.z**2, FAR**2)))), math.nan, "1")}
    moved, sd = explained(errors, errors.slopes)
    for k, i in enumerate(q.free):
        one = q.model.parameters[i]
        if one.name in asked:
            found[one.name] = Quantity(
                float(p[i] + moved[k]), float(sd[k]), one.unit, share(errors, errors.slopes[:, k])
            )
    effects = _admitted(rig.model, tuple(watch))
    for number, effect in enumerate(effects):
        progress((number + 1) / (len(effects) + 1), effect.name)
        found |= _sizes(own, effect, thin, p, q, guide, errors)
    return found


@lru_cache(maxsize=8)
def _freed_daily(rig: Rig) -> Rig:
    """The rig with those parameters freed that change from day to day without any wear.

    One object for each rig, so that its models with effects are built once for all nights.
    """
    freed = {one.name for one in rig.freed}
    also = [
        Freed(one.name, *one.bounds, sd=one.daily * rig.parameters[one.name])
        for one in rig.model.parameters
        if one.daily and one.name not in freed
    ]
    return replace(rig, freed=(*rig.freed, *also))


@lru_cache(maxsize=64)
def _admitted(model: Model, watch: tuple[str, ...]) -> tuple[Effect, ...]:
    return tuple(one for one in admitted(model) if one.name in watch)


def _errors(q: LikelihoodProblem, p: Array, guide: Filtered) -> WindowErrors:
    free = list(q.free)
    P = np.tile(p, (len(free) + 1, 1))
    steps = np.where(p[free] + NUDGE * q.typical > q.high, -NUDGE, NUDGE) * q.typical
    P[range(1, len(P)), free] += steps
    resets = window_starts(q.problem, WINDOW)
    z, *others = innovations(q, P, q.model, guide, None, resets)
    known = np.isfinite(guide.innovations[0])
    owner = np.repeat(q.problem.recording, q.problem.counts + 1)
    block = np.floor(q.problem.time / CLUSTER + 1e-9).astype(np.int64)
    cluster = np.unique(np.stack([owner, block]), axis=1, return_inverse=True)[1].ravel()
    slopes = ((np.array(others) - z) / steps[:, None]).T if free else np.zeros((len(z), 0))
    return WindowErrors(z, slopes, np.broadcast_to(cluster[:, None], known.shape)[known])


def _sizes(
    rig: Rig,
    effect: Effect,
    recordings: Sequence[Recording],
    p: Array,
    plain: LikelihoodProblem,
    guide: Filtered,
    errors: WindowErrors,
) -> dict[str, Quantity]:
    """The size of each strength of an effect, estimated together with the parameters, one at a time."""
    wide = with_effect(rig, effect)
    q = replace(plain, rig=wide, problem=build_problem(wide.model, recordings, WHOLE))
    here = {one.name: float(value) for one, value in zip(plain.model.parameters, p, strict=True)}
    moves = points(effect)
    P = np.array([q.at({**here, **effect.qualified(point)}) for _, point, _ in moves])
    seen = innovations(q, P, plain.model, guide, None, window_starts(plain.problem, WINDOW))
    found, null = {}, effect.at_null()
    units = {one.name: one.unit for one in effect.parameters}
    for (name, _, step), z in zip(moves, seen, strict=True):
        slope = np.where(np.abs(z) < LOST, z - errors.z, 0.0) / step
        moved, sd = explained(errors, np.column_stack([errors.slopes, slope]))
        if sd[-1] > 0.0:
            value, part = null[name] + float(moved[-1]), share(errors, slope)
            found[f"{effect.name}.{name}"] = Quantity(value, float(sd[-1]), units[name], part)
    return found


def points(effect: Effect) -> list[tuple[str, dict[str, float], float]]:
    """For each strength: its name, the effect's parameters with it moved from the null, and the step."""
    null, moves = effect.at_null(), []
    shape = {**null, **effect.usual[len(effect.usual) // 2]} if effect.usual else dict(null)
    shape |= {name: null[name] for name in effect.strength}
    for name, least in effect.strength.items():
        sizes = [one[name] - null[name] for one in effect.usual if one.get(name, null[name]) != null[name]]
        step = PART * min(sizes, key=abs) if sizes else 10.0 * least
        moves.append((name, {**shape, name: null[name] + step}, step))
    return moves


def share(errors: WindowErrors, slope: Array) -> float:
    """Share of the squared errors explained by one quantity alone; outliers count linearly."""
    weight = huber_weight(errors.z)
    across = float(slope @ (weight * errors.z))
    return across**2 / max(float(slope @ (weight * slope)) * float(errors.z @ (weight * errors.z)), 1e-300)


def explained(errors: WindowErrors, slopes: Array) -> tuple[Array, Array]:
    """The amount of each slope (rows, some) that explains the errors best, and its sd, (some,) each.

    Errors beyond `FAR` sd count linearly (Huber); the sd are those that the scatter among clusters gives (sandwich).
    """
    if not slopes.shape[1]:
        return np.zeros(0), np.zeros(0)
    norms = np.linalg.norm(slopes, axis=0)
    scaled = slopes / np.where(norms > 0.0, norms, 1.0)
    weight = huber_weight(errors.z)
    values, vectors = np.linalg.eigh((scaled.T * weight) @ scaled)
    inverse = vectors @ np.diag(np.where(values > SLIGHT, 1.0 / np.maximum(values, SLIGHT), 0.0)) @ vectors.T
    moved = -inverse @ (scaled.T @ (weight * errors.z))
    left = weight * (errors.z + scaled @ moved)
    score = np.zeros((int(errors.cluster.max()) + 1, slopes.shape[1]))
    np.add.at(score, errors.cluster, scaled * left[:, None])
    covariance = inverse @ (score.T @ score) @ inverse
    back = np.where(norms > 0.0, 1.0 / np.maximum(norms, 1e-300), 0.0)
    return moved * back, np.sqrt(np.maximum(np.diag(covariance), 0.0)) * back
