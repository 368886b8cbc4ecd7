"""Sensitivities: the changes of the innovations along recordings by each rival and by the free parameters.

As in the score test of a diagnosis: models are corrected with the gains of the base model's filter, and the difference
of their innovations, in sd, is one column. Inner products of columns add over recordings.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from optid.core.model import Array
from optid.core.recording import Recording
from optid.effects.effect import Effect
from optid.estimation.fisher_scoring import likelihood_problem, point_at
from optid.estimation.likelihood import FAR, WHOLE, run_fixed_gain_filter
from optid.estimation.likelihood_point import LikelihoodFit
from optid.estimation.problem import build_problem
from optid.rigs.rigfile import Rig, with_effects

# Log level of process noise of a model that is nearly right, in usual sizes per sqrt(s). With a tenth of it models
# run nearly freely, and the separation of a whole experiment is no longer the sum of its pieces.
QUIET = math.log(1e-2)


@dataclass(frozen=True)
class Layout:
    """Meaning of the columns: the slopes by free parameters, then the forms of each rival.

    Attributes:
        slopes: their number.
        worth: for each rival, the columns of its branches at the smallest size worth a name.
        forms: for each rival, all its columns: these, and its branches at their usual size.
    """

    slopes: int
    worth: tuple[tuple[int, ...], ...]
    forms: tuple[tuple[int, ...], ...]


@dataclass(frozen=True, eq=False)
class Grams:
    """Inner products of the columns along each recording, (recordings, columns, columns).

    Rivals' columns are per smallest size worth a name, slopes per typical size, both in sd of the innovations.
    """

    layout: Layout
    values: Array


def grams(
    rig: Rig, rivals: Sequence[Effect], recordings: Sequence[Recording], skip: int = 0, robust: bool = True
) -> Grams:
    """The inner products along recordings of the rig's own model.

    Args:
        rig: its parameters are taken as true; every measured output has an sd.
        rivals: effects that its model can take.
        recordings: of one run each.
        skip: samples at the beginning of each that do not count.
        robust: weigh samples as a likelihood would in the presence of the largest rival; of little use for rivals of
            very different size.

    Raises:
        SolveError: the model cannot be simulated along them.
    """
    question = likelihood_problem(rig, build_problem(rig.model, recordings, WHOLE))
    levels = np.full(len(question.groups), QUIET)
    here = point_at(question, rig.model.vector(rig.parameters), levels)
    here.fixed_gain_jacobian()
    answer = here.as_fit(False)
    view = _View(answer, skip)
    columns, worth, forms, count = [view.slopes], [], [], view.slopes.shape[1]
    for effect in rivals:
        least, usual = _points(effect)
        near, far = view.changes(effect, least, recordings), view.changes(effect, usual, recordings)
        far = far[:, np.isfinite(far).all(axis=0)]  # at its usual size the simulation of a form may diverge
        columns += [near, far]
        worth.append(tuple(range(count, count + near.shape[1])))
        count += near.shape[1] + far.shape[1]
        forms.append(tuple(range(worth[-1][0], count)))
    C = _weighted(np.concatenate(columns, axis=1), [k for each in worth for k in each] if robust else [])
    layout = Layout(view.slopes.shape[1], tuple(worth), tuple(forms))
    parts = (C[view.owner == k] for k in range(len(recordings)))
    return Grams(layout, np.array([part.T @ part for part in parts]))


def _weighted(C: Array, worth: Sequence[int]) -> Array:
    """Rows weighted as in a likelihood in the presence of the largest rival; zero where a model diverged.

    Whole rows, including slopes: linear dependences between columns are kept.
    """
    sound = np.asarray(np.isfinite(C).all(axis=1))
    far = np.abs(C[:, worth]).max(axis=1, where=np.isfinite(C[:, worth]), initial=0.0) if worth else 0.0
    weight = np.where(sound, np.sqrt(FAR / np.maximum(far, FAR)), 0.0)
    return np.asarray(np.where(sound[:, None], C, 0.0) * weight[:, None])


def _points(effect: Effect) -> tuple[list[dict[str, float]], list[dict[str, float]]]:
    """An effect's branches at the smallest size worth a name, and at their usual size."""
    null = effect.at_null()
    usual = [{**null, **branch} for branch in effect.usual]
    least = [
        {
            name: null[name] + (value - null[name]) / effect.size(point) if name in effect.strength else value
            for name, value in point.items()
        }
        for point in usual
    ]
    return least, [point for point in usual if effect.size(point) > 1.0]


class _View:
    """The base model's innovations: which are known, their scale, and the slopes by its parameters."""

    def __init__(self, answer: LikelihoodFit, skip: int) -> None:
        f, q = answer.filtered, answer.likelihood_problem
        self._answer = answer
        own = range(len(q.model.states))
        self._base = run_fixed_gain_filter(q.model, q.problem, answer.p[None], f, own)[0]
        slopes = answer.slopes.innovations[..., : len(q.free)]
        self._known = (
            np.isfinite(f.innovations[0]) & np.isfinite(self._base) & np.isfinite(slopes).all(axis=-1)
        )
        late = np.concatenate([np.arange(count + 1) >= skip for count in q.problem.counts])
        self._known &= late[:, None]
        self._scale = 1.0 / np.sqrt(f.variances[0][self._known])
        self.slopes = slopes[self._known] * self._scale[:, None]
        samples = np.repeat(q.problem.recording, q.problem.counts + 1)
        self.owner = samples[np.nonzero(self._known)[0]]

    def changes(
        self, effect: Effect, points: Sequence[dict[str, float]], recordings: Sequence[Recording]
    ) -> Array:
        """Columns by point, each per smallest size worth a name, (rows, points)."""
        if not points:
            return np.empty((len(self.owner), 0))
        plain = self._answer.likelihood_problem
        rig = with_effects(plain.rig, (effect,), {})
        model = rig.model
        P = np.empty((len(points), len(model.parameters)))
        P[:] = model.vector_from(plain.model, self._answer.p, rig.parameters)
        for row, point in zip(P, points, strict=True):
            for name, value in effect.qualified(point).items():
                row[model.index(name)] = value
        names = [state.name for state in model.states]
        common = [names.index(state.name) for state in plain.model.states]
        E = run_fixed_gain_filter(
            model, build_problem(model, recordings, WHOLE), P, self._answer.filtered, common
        )
        found = (E - self._base)[:, self._known] * self._scale
        return np.asarray(found.T / [effect.size(point) for point in points])
