"""The test of a night: where one recording's worth of data puts a fitted model's parameters, and effects it lacks.

Nothing is searched. Errors of short windows are taken at the fitted parameters under the gains of a quiet filter, and
once more with each parameter, and each watched effect, moved a little. One linear regression each then says by how much
of it these errors are explained best (a one-step estimate; van der Vaart, Asymptotic Statistics, 1998, section 5.7).
Whether a rig has changed is not said here: its nights are compared with each other (`optid.fleet.statistics`).
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from optid.api.document import stamp
from optid.api.inputs import Progress, given, refuse_unfit, rig_of, silent
from optid.core.model import Array, Model
from optid.core.recording import Recording
from optid.diagnosis.problem import prepare, with_effect
from optid.effects.effect import Effect
from optid.effects.library import admitted, built_in
from optid.errors import InputError, SolveError, nearest
from optid.estimation.fisher_scoring import likelihood_problem
from optid.estimation.fixed_gain import LOST, innovations
from optid.estimation.likelihood import FAR, WHOLE, Filtered
from optid.estimation.likelihood_point import LikelihoodProblem
from optid.estimation.multistep import quiet_filter, window_starts
from optid.estimation.prediction import HORIZON
from optid.estimation.problem import build_problem
from optid.rigs.rigfile import Rig

if TYPE_CHECKING:
    from optid.api.inputs import Recordings

SCHEMA = "optid.test/1"
FILE = "test.json"
RATE = 500.0  # Hz at most, as a diagnosis searches
WINDOW = 0.1  # s: short enough for errors to stay in proportion to what causes them
NUDGE = 1e-2  # of a parameter's typical size, by which its slope is taken
PART = 0.5  # of the smallest usual size of an effect, likewise: a dead band or a play is no straight line from its null
CLUSTER = HORIZON  # s: errors nearer to each other than that are not counted as independent
SLIGHT = 1e-6  # of the curvature, of directions that the data do not show
ERROR = "prediction_error"  # quantity: log of the windows' error over the noise


@dataclass(frozen=True)
class Quantity:
    """Where the data put one quantity: SI value, and the sd that the scatter of windows gives it."""

    value: float
    sd: float
    unit: str


@dataclass(frozen=True, eq=False)
class _Errors:
    """Windows' errors at the fitted parameters, in sd, their slopes, and which cluster each belongs to."""

    z: Array
    slopes: Array
    cluster: np.ndarray[Any, np.dtype[np.int64]]


def night_test(
    rig: str | Path | Rig,
    recordings: Recordings,
    *,
    watch: Sequence[str],
    rate: float | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Estimate what may have changed of a fitted rig, from one night's recordings, in a second.

    Parameters
    ----------
    rig : str | Path | Rig
        fitted: the file that `optid fit` writes; its [fit] table says which parameters are followed.
    recordings : Recordings
        of one night.
    watch : Sequence[str]
        names of effects whose sizes are followed as well; those that the plant does not admit are left out.
    rate : float | None
        Hz to bring faster recordings down to.
    progress : Progress
        called with the share done and a few words.

    Returns
    -------
    dict[str, Any]
        Content of `test.json`: `quantities`, by name, value, sd, 95 % interval and unit.

    Raises
    ------
    InputError
        an input is wrong, or an effect is unknown.
    NotIdentifiable
        a recording is unfit.
    SolveError
        the model cannot be simulated.
    """
    began = time.process_time()
    if unknown := [name for name in watch if name not in built_in()]:
        raise InputError(f'no effect "{unknown[0]}"', field="watch", hint=nearest(unknown[0], built_in()))
    understood = rig_of(rig)
    data, _ = given(understood, recordings, rate=rate)
    refuse_unfit(data)
    found = quantities(understood, [one.recording for one in data], watch, progress)
    half = 1.96
    return {
        **stamp(SCHEMA, "test", understood, [one.recording for one in data]),
        "rig": understood.name,
        "quantities": {
            name: {
                "value": one.value,
                "sd": one.sd if math.isfinite(one.sd) else None,
                "unit": one.unit,
                "ci95": [one.value - half * one.sd, one.value + half * one.sd]
                if math.isfinite(one.sd)
                else None,
            }
            for name, one in found.items()
        },
        "seconds": round(time.process_time() - began, 3),
    }


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
    rig, thin = prepare(rig, recordings, RATE)
    q = likelihood_problem(rig, build_problem(rig.model, thin, WHOLE), rig.model)
    p = q.model.vector(rig.parameters)
    guide = quiet_filter(q, p)
    if guide is None:
        raise SolveError("the simulation diverged at the fitted parameters")
    errors = _errors(q, p, guide)
    asked = {one.name for one in rig.freed}
    found = {ERROR: Quantity(0.5 * math.log(float(np.mean(np.minimum(errors.z**2, FAR**2)))), math.nan, "1")}
    moved, sd = _explained(errors, errors.slopes)
    for k, i in enumerate(q.free):
        one = q.model.parameters[i]
        if one.name in asked:
            found[one.name] = Quantity(float(p[i] + moved[k]), float(sd[k]), one.unit)
    effects = _admitted(rig.model, tuple(watch))
    for number, effect in enumerate(effects):
        progress((number + 1) / (len(effects) + 1), effect.name)
        found |= _sizes(rig, effect, thin, p, q, guide, errors)
    return found


@lru_cache(maxsize=64)
def _admitted(model: Model, watch: tuple[str, ...]) -> tuple[Effect, ...]:
    return tuple(one for one in admitted(model) if one.name in watch)


def _errors(q: LikelihoodProblem, p: Array, guide: Filtered) -> _Errors:
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
    return _Errors(z, slopes, np.broadcast_to(cluster[:, None], known.shape)[known])


def _sizes(
    rig: Rig,
    effect: Effect,
    recordings: Sequence[Recording],
    p: Array,
    plain: LikelihoodProblem,
    guide: Filtered,
    errors: _Errors,
) -> dict[str, Quantity]:
    """What each strength of an effect comes to beside the parameters, one at a time."""
    wide = with_effect(rig, effect)
    q = replace(plain, rig=wide, problem=build_problem(wide.model, recordings, WHOLE))
    here = {one.name: float(value) for one, value in zip(plain.model.parameters, p, strict=True)}
    points = _points(effect)
    P = np.array([q.at({**here, **effect.qualified(point)}) for _, point, _ in points])
    seen = innovations(q, P, plain.model, guide, None, window_starts(plain.problem, WINDOW))
    found, null = {}, effect.at_null()
    units = {one.name: one.unit for one in effect.parameters}
    for (name, _, step), z in zip(points, seen, strict=True):
        slope = np.where(np.abs(z) < LOST, z - errors.z, 0.0) / step
        moved, sd = _explained(errors, np.column_stack([errors.slopes, slope]))
        if sd[-1] > 0.0:
            found[f"{effect.name}.{name}"] = Quantity(
                null[name] + float(moved[-1]), float(sd[-1]), units[name]
            )
    return found


def _points(effect: Effect) -> list[tuple[str, dict[str, float], float]]:
    """For each strength: its name, the effect's parameters with it moved from the null, and by how much."""
    null, points = effect.at_null(), []
    shape = {**null, **effect.usual[len(effect.usual) // 2]} if effect.usual else dict(null)
    shape |= {name: null[name] for name in effect.strength}
    for name, least in effect.strength.items():
        sizes = [one[name] - null[name] for one in effect.usual if one.get(name, null[name]) != null[name]]
        step = PART * min(sizes, key=abs) if sizes else 10.0 * least
        points.append((name, {**shape, name: null[name] + step}, step))
    return points


def _explained(errors: _Errors, slopes: Array) -> tuple[Array, Array]:
    """By how much of each slope (rows, some) the errors are explained best, and the sd of that, (some,) each.

    Errors beyond `FAR` sd count linearly (Huber); the sd are those that the scatter among clusters gives (sandwich).
    """
    if not slopes.shape[1]:
        return np.zeros(0), np.zeros(0)
    size = np.linalg.norm(slopes, axis=0)
    scaled = slopes / np.where(size > 0.0, size, 1.0)
    weight = np.minimum(1.0, FAR / np.maximum(np.abs(errors.z), 1e-12))
    values, vectors = np.linalg.eigh((scaled.T * weight) @ scaled)
    inverse = vectors @ np.diag(np.where(values > SLIGHT, 1.0 / np.maximum(values, SLIGHT), 0.0)) @ vectors.T
    moved = -inverse @ (scaled.T @ (weight * errors.z))
    left = weight * (errors.z + scaled @ moved)
    score = np.zeros((int(errors.cluster.max()) + 1, slopes.shape[1]))
    np.add.at(score, errors.cluster, scaled * left[:, None])
    covariance = inverse @ (score.T @ score) @ inverse
    back = np.where(size > 0.0, 1.0 / np.maximum(size, 1e-300), 0.0)
    return moved * back, np.sqrt(np.maximum(np.diag(covariance), 0.0)) * back
