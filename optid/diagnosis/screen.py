"""A first look at many effects: how much of the innovations each would explain, without refitting anything.

Every branch of an effect is simulated with the gains of the fitted model's filter. What its innovations gain over
the fitted model's, after the fitted parameters have had their linear say (the score test's projection), ranks it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from optid.core.model import Array
from optid.core.recording import Recording
from optid.effects.effect import Effect
from optid.estimation.likelihood import FAR, WHOLE, run_steered
from optid.estimation.place import Answer
from optid.estimation.problem import Booleans, Integers, Problem, pose
from optid.rigs.rigfile import Rig, with_effects

SHARES = (0.3, 1.0)  # of an effect's usual size at which it is tried
LOST = 30.0  # sd: a change beyond it is a model that lost track under held gains, and says nothing
FARTHEST = 3.0  # the line from null through a branch's usual size is followed so far


@dataclass(frozen=True, eq=False)
class Signature:
    """What one branch of an effect would change.

    Attributes:
        effect: the effect.
        values: of its parameters, by own name, where the line search along the branch ends.
        gain: by which the sum of squared, scaled innovations would fall.
        change: of the scaled innovations at the simulated point of the branch, (rows,).
        size: of that point, in smallest sizes worth a name.
        visible: sd by which the effect at the smallest size worth a name stands out after a refit of the parameters.
        beside: values of the other parameters where it led from afar, by name; nothing if a screen found it.
    """

    effect: Effect
    values: Mapping[str, float]
    gain: float
    change: Array
    size: float
    visible: float
    beside: Mapping[str, float] = field(default_factory=dict)


def screen(answer: Answer, recordings: Sequence[Recording], effects: Iterable[Effect]) -> list[Signature]:
    """The best branch of every effect, the most promising first."""
    view = View.of(answer)
    found = [_best(answer, recordings, effect, view) for effect in effects]
    return sorted((s for s in found if s is not None), key=lambda s: -s.gain)


@dataclass(frozen=True, eq=False)
class View:
    """Scaled innovations as one column z, and an orthonormal basis of what the parameters can do to them."""

    known: Booleans  # (samples, outputs)
    scale: Array
    weight: Array
    z: Array
    J: Array  # slopes of z by the free parameters' typical sizes, (rows, free)
    basis: Array
    base: Array  # innovations of the steered plain model

    @staticmethod
    def of(answer: Answer) -> View:
        """At a fitted model."""
        f, q = answer.filtered, answer.question
        e, v = f.innovations[0], f.variances[0]
        own = run_steered(q.model, q.problem, answer.p[None], f, range(len(q.model.states)))[0]
        slopes = answer.slopes.innovations[..., : len(q.free)]
        known = np.isfinite(e) & np.isfinite(own) & np.isfinite(slopes).all(axis=-1)
        scale = 1.0 / np.sqrt(v[known])
        z = e[known] * scale
        weight = np.sqrt(np.minimum(1.0, FAR / np.maximum(np.abs(z), 1e-12)))
        J = slopes[known] * (scale * weight)[:, None]
        size = np.linalg.norm(J, axis=0)
        unit = J[:, size > 0] / size[size > 0]
        basis = np.linalg.svd(unit, full_matrices=False)[0] if unit.size else np.zeros((len(z), 0))
        return View(known, scale, weight, z * weight, J, basis, own)

    @property
    def rows(self) -> Integers:
        """The sample of each row."""
        return np.asarray(np.nonzero(self.known)[0])

    def rows_owner(self, problem: Problem) -> Integers:
        """The recording of each row."""
        return np.asarray(np.repeat(problem.recording, problem.counts + 1)[self.rows])

    def projected(self, column: Array) -> Array:
        """What of a column the parameters cannot take."""
        return np.asarray(column - self.basis @ (self.basis.T @ column))


@lru_cache(maxsize=64)
def grown(rig: Rig, effect: Effect) -> Rig:
    """A rig with one more effect, at nothing; remembered, so that every look of a round has one compiled model."""
    return with_effects(rig, (effect,), {})


def _best(answer: Answer, recordings: Sequence[Recording], effect: Effect, view: View) -> Signature | None:
    rig = grown(answer.question.rig, effect)
    model, plain = rig.model, answer.question.model
    problem = pose(model, recordings, WHOLE)
    null = effect.at_null()
    points = [
        {name: null[name] + (share * (value - null[name]) if name in effect.strength else value - null[name])
         for name, value in ({**null, **branch}).items()}
        for branch in effect.tries(*heard(answer)) for share in SHARES
    ]  # fmt: skip
    P = np.empty((len(points), len(model.parameters)))
    P[:] = model.vector_from(plain, answer.p, rig.parameters)
    for row, point in zip(P, points, strict=True):
        for name, value in effect.qualified(point).items():
            row[model.index(name)] = value
    names = [state.name for state in model.states]
    common = [names.index(state.name) for state in plain.states]
    E = run_steered(model, problem, P, answer.filtered, common)
    own = view.projected(view.z)
    best: Signature | None = None
    for point, e in zip(points, E, strict=True):
        change = (e[view.known] - view.base[view.known]) * view.scale * view.weight
        if not np.isfinite(change).all():
            continue
        change[np.abs(change) > LOST] = 0.0
        d = view.projected(change)
        length = float(d @ d)
        if length < 1e-9:
            continue
        along = min(max(-float(own @ d) / length, 0.0), FARTHEST)
        gain = -2.0 * along * float(own @ d) - along**2 * length
        if best is None or gain > best.gain:
            values = {
                name: null[name] + along * (value - null[name]) if name in effect.strength else value
                for name, value in point.items()
            }
            size = effect.size(point)
            best = Signature(effect, values, gain, change, size, float(np.sqrt(length)) / size)
    return best


def heard(answer: Answer) -> tuple[list[Array], float]:
    """What the plain model's predictions of the first output miss in every stretch of data, and the sampling time."""
    problem, missed = answer.question.problem, answer.filtered.innovations[0][:, 0]
    stretches = zip(problem.begins, problem.counts, strict=True)
    return [missed[first : first + count + 1] for first, count in stretches], float(np.median(problem.dt))
