"""Where effects lead from the values that the rig file states, under the gains of one filter.

A fitted model that lacks something large has bent its parameters to make up for it: no small change from there shows
what is missing, and searches that begin there end beside it. So effects are tried from where nothing is bent yet, all
parameters free, by a search that goes far and costs little because gains are held. What innovations each effect leaves
ranks it, and where it led is where its refit begins.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from optid.core.model import Array, Model
from optid.diagnose.candidate import QUICK, Candidate, Data
from optid.diagnose.screen import Signature, grown, heard
from optid.effects.effect import Effect
from optid.errors import SolveError
from optid.fit.likelihood import FAR, Noise, huber
from optid.fit.place import NUDGES, Answer, Place, Question
from optid.fit.steering import Steered, innovations, steered_fit
from optid.rigs.rigfile import Rig

BRANCHES = 3  # of an effect, that are led at all
# The race: evaluations of each lead, how many go on, and how many of one effect. The many of the first leg run over the
# recording in which most is missing, those that are left over all.
RACE = ((3, 24, 2), (5, 8, 1), (QUICK, 8, 1))
WORTHY = 0.5  # of the best gain: what gains less is not worth a refit


def leads(
    current: Candidate,
    guide: Answer,
    effects: Sequence[Effect],
    data: Data,
    plain: Model,
    *,
    near: bool = False,
    race: Sequence[tuple[int, int, int]] = RACE,
) -> list[Signature]:
    """What effects gain where they lead, the most promising first.

    They begin at the rig file's values, and only if nothing gains from there, as these are far off, at the fitted
    ones; beside other effects where the guide stands, which is about where all of them belong.

    Args:
        current: the model that they come to.
        guide: of the same model, whose gains hold.
        effects: to try.
        data: recordings.
        plain: the model as it came.
        near: begin where the guide stands in any case.
        race: its legs, as in RACE.
    """
    q = guide.question
    starts = [guide.p] if near or current.effects else [q.model.vector(current.rig.parameters), guide.p]
    alone = min(steered_fit(q, start, q.model, guide.filtered, QUICK).loss for start in starts)
    rows, first = int(np.isfinite(guide.filtered.innovations[0]).sum()), worst(guide)
    for start in starts:
        ground = Ground.of(current.rig, guide, data, plain, start)
        running = [lead for effect in effects for lead in _begun(ground, effect)]
        for leg, (evaluations, most, alike) in enumerate(race):
            if data.over:
                return []
            over = None if leg else first
            running = _ahead([lead.further(guide, evaluations, over) for lead in running], most, alike)
        gains = [rows * (1.0 - lead.at.loss / alone) for lead in running]  # of as many squares as rows
        if gains and gains[0] > 0.0:
            worthy = [gain > WORTHY * gains[0] for gain in gains]
            return [
                lead.signature(gain) for lead, gain, good in zip(running, gains, worthy, strict=True) if good
            ]
    return []


def stood(current: Candidate, led: Signature, guide: Answer, data: Data, plain: Model) -> Answer | None:
    """A model with an effect where it led to, its states as quiet as the guide's; ``None`` if that is no model."""
    question = data.question(grown(current.rig, led.effect), plain)
    p = question.model.vector({**question.rig.parameters, **led.beside, **led.effect.qualified(led.values)})
    here = Place(question, p, Noise(question.measurement, question.groups, guide.noise.levels))
    if not math.isfinite(here.score):
        return None
    here.glance()
    return here.answer(False)


def worst(guide: Answer) -> list[int]:
    """The segments of the recording in which most is missing."""
    problem, f = guide.question.problem, guide.filtered
    loss = np.nansum(huber(f.innovations[0] / np.sqrt(f.variances[0])), axis=1)
    lost = np.bincount(np.repeat(problem.recording, problem.counts + 1), weights=loss)
    return np.flatnonzero(problem.recording == np.argmax(lost)).tolist()


@dataclass(frozen=True, eq=False)
class Ground:
    """Where leads begin.

    Attributes:
        rig: without the effect.
        guide: whose gains hold.
        data: recordings.
        plain: the model as it came, whose states alone carry process noise.
        values: of the parameters there, by name.
        slopes: of the scaled innovations by the free parameters there, in typical sizes, (measured, free).
    """

    rig: Rig
    guide: Answer
    data: Data
    plain: Model
    values: Mapping[str, float]
    slopes: Array

    @classmethod
    def of(cls, rig: Rig, guide: Answer, data: Data, plain: Model, start: Array) -> Self:
        """At a start, (parameters,)."""
        q = guide.question
        free = list(q.free)
        P = np.tile(start, (len(free) + 1, 1))
        steps = np.where(start[free] + NUDGES[1] * q.typical > q.high, -NUDGES[1], NUDGES[1])
        P[range(1, len(P)), free] += steps * q.typical
        here, *others = innovations(q, P, q.model, guide.filtered)
        values = dict(zip((one.name for one in q.model.parameters), start.tolist(), strict=True))
        return cls(rig, guide, data, plain, values, ((np.array(others) - here) / steps[:, None]).T)

    def placed(self, question: Question, own: Mapping[str, float]) -> Array:
        """All parameters of a question with an effect's `own`, by qualified name."""
        model = question.model
        p = model.vector(question.rig.parameters)
        for name, value in {**self.values, **own}.items():
            low, high = model.parameters[model.index(name)].bounds
            p[model.index(name)] = min(max(value, low), high)
        return p

    def losses(self, question: Question, P: Array) -> Array:
        """What the free parameters' linear say leaves of the innovations, by Huber's weights, (sets,)."""
        found = np.empty(len(P))
        for k, z in enumerate(innovations(question, P, self.guide.question.model, self.guide.filtered)):
            root = np.sqrt(np.minimum(1.0, FAR / np.maximum(np.abs(z), 1e-12)))
            step = np.linalg.lstsq(self.slopes * root[:, None], -root * z, rcond=1e-9)[0]
            found[k] = huber(z + self.slopes @ step).sum()
        return found


@dataclass(frozen=True, eq=False)
class _Lead:
    """An effect on its way, from parameters of which `beside` are not its own."""

    effect: Effect
    question: Question
    beside: Sequence[str]
    at: Steered

    def further(self, guide: Answer, evaluations: int, over: Sequence[int] | None = None) -> Self:
        """The same, so many evaluations further `over` some segments; lost where it leaves the numbers."""
        plain, f = guide.question.model, guide.filtered
        try:
            at = steered_fit(self.question, self.at.p, plain, f, evaluations, over)
        except SolveError:
            at = Steered(self.at.p, math.inf)
        return replace(self, at=at)

    def signature(self, gain: float) -> Signature:
        """For a refit to begin with."""
        values = dict(zip((q.name for q in self.question.model.parameters), self.at.p.tolist(), strict=True))
        own = {q.name: values[f"{self.effect.name}.{q.name}"] for q in self.effect.parameters}
        beside = {name: values[name] for name in self.beside}
        return Signature(self.effect, own, gain, np.zeros(0), self.effect.size(own), math.inf, beside)


def _begun(ground: Ground, effect: Effect) -> list[_Lead]:
    """The branches of an effect that promise most, where they begin."""
    question = ground.data.question(grown(ground.rig, effect), ground.plain)
    branches = [effect.qualified({**effect.at_null(), **one}) for one in effect.tries(*heard(ground.guide))]
    P = np.array([ground.placed(question, branch) for branch in branches])
    losses = ground.losses(question, P)
    first = np.argsort(losses)[:BRANCHES]
    return [_Lead(effect, question, tuple(ground.values), Steered(P[k], float(losses[k]))) for k in first]


def _ahead(running: list[_Lead], most: int, alike: int) -> list[_Lead]:
    """The best of a race, so many of one effect at most."""
    kept: list[_Lead] = []
    for lead in sorted(running, key=lambda one: one.at.loss):
        if len(kept) < most and sum(one.effect is lead.effect for one in kept) < alike:
            kept.append(lead)
    return kept
