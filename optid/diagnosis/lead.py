"""Where effects lead from a fitted model, all parameters free, under the gains of one filter.

Held gains make a search cheap. What innovations each effect leaves ranks it, and where it led is where its refit, or
the turns after it, begin. What is missing altogether is looked for from `afar`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Self

import numpy as np

from optid.core.model import Array, Model
from optid.core.threads import together
from optid.diagnosis.candidate import Candidate, Data
from optid.diagnosis.screen import Signature, grown, heard
from optid.effects.effect import Effect
from optid.errors import SolveError
from optid.estimation.likelihood import FAR, Filtered, Noise, huber
from optid.estimation.place import NUDGES, Answer, Place, Question
from optid.estimation.problem import Booleans
from optid.estimation.steering import STEPS, Steered, innovations, steered_fit
from optid.rigs.rigfile import Rig

BRANCHES = 3  # of an effect, that are led at all
# The race: steps of each lead, how many go on, and how many of one effect. The many of the first leg run over the
# recording in which most is missing, those that are left over all.
RACE = ((1, 24, 2), (2, 8, 1), (STEPS, 8, 1))
LITTLE = 0.1  # of a way, by which its slope is taken
WORTHY = 0.5  # of the best gain: what gains less is not worth a refit


def leads(
    current: Candidate,
    guide: Answer,
    effects: Sequence[Effect],
    data: Data,
    plain: Model,
) -> list[Signature]:
    """What effects gain where they lead from where the guide stands, the most promising first.

    Args:
        current: the model that they come to.
        guide: of the same model, whose gains hold.
        effects: to try.
        data: recordings.
        plain: the model as it came.
    """
    q = guide.question
    alone = steered_fit(q, guide.p, q.model, guide.filtered, STEPS).loss
    first = worst(guide)
    ground = Ground.of(current.rig, guide, data, plain, guide.p)
    running = [lead for effect in effects for lead in ahead(ground.begun(effect), BRANCHES, BRANCHES)]
    for leg, (steps, most, alike) in enumerate(RACE):
        if data.over:
            return []
        over = None if leg else first
        further = partial(Lead.further, plain=q.model, guide=guide.filtered, steps=steps, over=over)
        running = ahead(together(further, running), most, alike)
    return worthy(running, alone, guide)


def worthy(running: Sequence[Lead], alone: float, guide: Answer) -> list[Signature]:
    """Leads, the best first, that gain over the loss of the model `alone`, and not much less than the best."""
    rows = int(np.isfinite(guide.filtered.innovations[0]).sum())
    gains = [rows * (1.0 - lead.at.loss / alone) for lead in running]  # of as many squares as rows
    least = WORTHY * max([0.0, *gains])
    return [lead.signature(gain) for lead, gain in zip(running, gains, strict=True) if gain > least]


def stood(current: Candidate, led: Signature, guide: Answer, data: Data, plain: Model) -> Answer | None:
    """A model with an effect where it led to, its states as quiet as the guide's; ``None`` if that is no model."""
    question = data.question(grown(current.rig, led.effect), plain)
    p = question.at({**led.beside, **led.effect.qualified(led.values)})
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
        guide: of the same model.
        held: whose gains hold, the guide's own filter or another of its model.
        data: recordings.
        plain: the model as it came, whose states alone carry process noise.
        values: of the parameters there, by name.
        slopes: of the scaled innovations by the free parameters there, in typical sizes, (measured, free).
        over, looks: as `innovations` has them.
    """

    rig: Rig
    guide: Answer
    held: Filtered
    data: Data
    plain: Model
    values: Mapping[str, float]
    slopes: Array
    over: Sequence[int] | None = None
    looks: Booleans | None = None

    @classmethod
    def of(
        cls,
        rig: Rig,
        guide: Answer,
        data: Data,
        plain: Model,
        start: Array,
        held: Filtered | None = None,
        over: Sequence[int] | None = None,
        looks: Booleans | None = None,
    ) -> Self:
        """At a start, (parameters,)."""
        q, held = guide.question, held or guide.filtered
        slopes = _sloped(q, start, lambda P: innovations(q, P, q.model, held, over, looks))
        values = dict(zip((one.name for one in q.model.parameters), start.tolist(), strict=True))
        return cls(rig, guide, held, data, plain, values, slopes, over, looks)

    def begun(self, effect: Effect) -> list[Lead]:
        """Every branch of an effect, by what is left once the other parameters have had their linear say.

        So have the effect's own ways.
        """
        question, null = self.data.question(grown(self.rig, effect), self.plain), effect.at_null()
        points = [{**null, **branch} for branch in effect.tries(*heard(self.guide))]
        turns = [{name: null[name] + LITTLE * by for name, by in way.items()} for way in effect.ways]
        points += [{**null, **turn} for turn in turns]
        P = np.array([self.placed(question, effect.qualified(point)) for point in points])
        seen = innovations(question, P, self.guide.question.model, self.held, self.over, self.looks)
        P, losses = P[: len(P) - len(turns)], self._losses(seen, len(turns))
        return [
            Lead(effect, question, tuple(self.values), Steered(p, float(loss)))
            for p, loss in zip(P, losses, strict=True)
        ]

    def placed(self, question: Question, own: Mapping[str, float]) -> Array:
        """All parameters of a question with an effect's `own`, by qualified name."""
        return question.at({**self.values, **own})

    def _losses(self, seen: Array, ways: int) -> Array:
        """What the linear say of free parameters and ways leaves of innovations, by Huber's weights, (branches,).

        The innovations are (branches + ways, measured); branches of an effect that has ways are all at its null.
        """
        begun = seen[: len(seen) - ways]
        own = (seen[len(begun) :] - begun[0]) / LITTLE
        slopes = np.column_stack([self.slopes, own.T])
        return np.array([_left(z, slopes) for z in begun])


def _sloped(q: Question, start: Array, seen: Callable[[Array], Array]) -> Array:
    """Slopes of innovations by the free parameters in typical sizes at a start, (measured, free).

    `seen` gives them for parameter sets (sets, parameters), (sets, measured).
    """
    free = list(q.free)
    P = np.tile(start, (len(free) + 1, 1))
    steps = np.where(start[free] + NUDGES[1] * q.typical > q.high, -NUDGES[1], NUDGES[1])
    P[range(1, len(P)), free] += steps * q.typical
    here, *others = seen(P)
    return np.asarray(((np.array(others) - here) / steps[:, None]).T)


def _left(z: Array, slopes: Array) -> float:
    """What of scaled innovations (rows,) a linear say by these slopes (rows, free) leaves, by Huber's weights."""
    root = np.sqrt(np.minimum(1.0, FAR / np.maximum(np.abs(z), 1e-12)))
    step = np.linalg.lstsq(slopes * root[:, None], -root * z, rcond=1e-9)[0]
    return float(huber(z + slopes @ step).sum())


@dataclass(frozen=True, eq=False)
class Lead:
    """An effect on its way, from parameters of which `beside` are not its own."""

    effect: Effect
    question: Question
    beside: Sequence[str]
    at: Steered

    def further(
        self,
        plain: Model,
        guide: Filtered,
        steps: int,
        over: Sequence[int] | None = None,
        looks: Booleans | None = None,
    ) -> Self:
        """The same, so many steps further, as `steered_fit` has it; lost where it leaves the numbers."""
        try:
            at = steered_fit(self.question, self.at.p, plain, guide, steps, over, looks)
        except SolveError:
            at = Steered(self.at.p, math.inf)
        return replace(self, at=at)

    def signature(self, gain: float) -> Signature:
        """For a refit to begin with."""
        values = dict(zip((q.name for q in self.question.model.parameters), self.at.p.tolist(), strict=True))
        own = {q.name: values[f"{self.effect.name}.{q.name}"] for q in self.effect.parameters}
        beside = {name: values[name] for name in self.beside}
        return Signature(self.effect, own, gain, np.zeros(0), self.effect.size(own), math.inf, beside)


def ahead(running: list[Lead], most: int, alike: int) -> list[Lead]:
    """The best of a race, so many of one effect at most."""
    kept: list[Lead] = []
    for lead in sorted(running, key=lambda one: one.at.loss):
        if len(kept) < most and sum(one.effect is lead.effect for one in kept) < alike:
            kept.append(lead)
    return kept
