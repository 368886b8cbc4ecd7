"""A model fitted to recordings and judged on others: the rig's own, with wider bounds, or with effects."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from optid.core.model import Array, Model
from optid.core.recording import Recording
from optid.core.threads import together
from optid.diagnosis.judge import EXCESS, Judged, excess, judge
from optid.effects.effect import Effect
from optid.errors import SolveError
from optid.estimation.likelihood import WHOLE
from optid.estimation.objective import stiffest
from optid.estimation.place import Answer, Place, Question
from optid.estimation.problem import pose
from optid.estimation.scoring import approach, followed, maximise, question_of, quieted
from optid.rigs.rigfile import Rig, with_effects

QUIETER = 2.5  # log: how much less process noise a second look and a first refit allow where much is missing
SCANNED = (0.0, 1.25, 2.5, 3.75)  # log: by how much less process noise may suit a first refit
SAME = 0.1  # of typical sizes: friction at rest that near is the same
# Bounds at which friction at rest neither yields nor creeps.
STUCK = {"presliding_length": -1, "presliding_shape": 1}
# Where searches for a contact's damping begin; at its default the fading hardly shows.
DAMPED = {"bristle_damping": 2e-4, "bristle_fading": 0.02}
ABOUT = 4.0  # times what a settled fit leaves: a first refit of the same model leaves no more
SKEW = "sampling_skew"
QUICK = 15  # iterations of a first refit; the best then converge

MOVED = 0.02  # of typical sizes: what recordings tell of themselves is looked at where it differs by more

Report = Callable[[float, str], None]


@dataclass(frozen=True)
class Data:
    """Recordings to fit, recordings held out, sd of their noise by role, and the randomness of the resampling.

    `misfit` is what the base model's simulation misses, by role, where models are judged by simulation; `late` are the
    recordings of which the beginning does not count; `until` is when searches end with what they have, by
    `time.monotonic`; where it is `rigid` a contact may be as short as its law allows, which takes twice the time.
    """

    train: tuple[Recording, ...]
    holdout: tuple[Recording, ...]
    noise: Mapping[str, float]
    generator: np.random.Generator
    misfit: Mapping[str, float] | None = None
    late: tuple[str, ...] = ()
    until: float = math.inf
    rigid: bool = False

    @property
    def over(self) -> bool:
        """Nothing more is tried: what was found has to do."""
        return time.monotonic() > self.until

    def question(self, rig: Rig, plain: Model, train: Sequence[Recording] | None = None) -> Question:
        """What the recordings to fit, or others, are asked of a rig; only states of `plain` carry process noise."""
        problem = pose(rig.model, self.train if train is None else train, WHOLE)
        question = replace(question_of(rig, problem, plain, self.misfit), until=self.until)
        return yielding_least(question) if self.rigid else question


@dataclass(frozen=True, eq=False)
class Candidate:
    """A fitted model, judged: the effects it has beyond the rig file's, its fit, and how it does on the hold-out."""

    effects: tuple[Effect, ...]
    rig: Rig
    answer: Answer
    judged: Judged


def fit_base(rig: Rig, data: Data, report: Report) -> Candidate:
    """The rig's own model at its likeliest parameters, from the file's values.

    How friction rests decides where a search goes, so there are two starts: a contact that yields, and one that
    sticks (its length at its least, its shape abrupt).
    """
    report(0.02, "fitting the base model")
    question = data.question(rig, rig.model)
    start = damped(question, rig.model.vector(rig.parameters))
    sticking = stuck(question, start)
    starts = [start] if np.array_equal(start, sticking) else [start, sticking]
    near = together(lambda p: approach(question, p), starts)
    if len(near) > 1 and not _alike(*near):  # the level of process noise may yet turn the choice
        near = together(_nearer, near)
    best = min(near, key=lambda answer: answer.score)
    report(0.06, "settling the base model")
    if excess(judge(best, data.holdout), data.noise) > EXCESS:
        best = _followed(best)
        # What is missing leaves more open than the last few units of likelihood would close.
        best = _quietly_unskewed(maximise(question, best.p, best.noise.levels, polish=False))
        rough = Candidate((), rig, best, judge(best, data.holdout))
        if excess(rough.judged, data.noise) > EXCESS:
            return rough
    base = settled((), rig, best.p, best, data, rig.model)
    if excess(base.judged, data.noise) <= EXCESS:
        return base
    other = _followed(base.answer)
    again = settled((), rig, other.p, other, data, rig.model)
    return min(base, again, key=lambda one: one.answer.score)


def damped(q: Question, p: Array) -> Array:
    """Parameters with the damping of friction at rest where a search for it begins, as far as it is free."""
    p = p.copy()
    for i in q.free:
        p[i] = DAMPED.get(q.model.parameters[i].name, p[i])
    return p


def stuck(q: Question, p: Array) -> Array:
    """Parameters with a contact that sticks: as short and as abrupt as may be, and damped as where searches begin."""
    p = damped(q, p)
    for k, i in enumerate(q.free):
        if (way := STUCK.get(q.model.parameters[i].name)) is not None:
            p[i] = (q.low if way < 0 else q.high)[k]
    return p


def yielding_least(q: Question) -> Question:
    """The question with a contact that may be as short as its law allows."""
    return replace(q, low=stiffest(q.model, q.free, q.low))


def unskewed(q: Question, p: Array) -> Array:
    """Parameters without a skew of the sampling, as far as that is free."""
    p = p.copy()
    p[[i for i in q.free if q.model.parameters[i].name == SKEW]] = 0.0
    return p


def _quietly_unskewed(answer: Answer) -> Answer:
    """From no skew of the sampling and with less process noise, where that is likelier.

    At first, in much noise, a skew stands in for what parameters and friction at rest still get wrong, and holds them.
    """
    p = unskewed(answer.question, answer.p)
    if np.array_equal(p, answer.p):
        return answer
    with contextlib.suppress(SolveError):  # so little noise may not hold the model to the data
        other = maximise(answer.question, p, answer.noise.levels - QUIETER, polish=False)
        return min(answer, other, key=lambda one: one.score)
    return answer


def _nearer(answer: Answer) -> Answer:
    """A few steps further, all filters anew."""
    return maximise(
        answer.question, answer.p, answer.noise.levels, iterations=QUICK, polish=False, near=answer
    )


def _followed(answer: Answer) -> Answer:
    """Where its own filter leads a model that errs: something is missing, or it does not stand on the highest top."""
    p, levels = followed(answer, quieted(answer, QUIETER).noise.levels, SCANNED)
    return replace(answer, p=p, noise=replace(answer.noise, levels=levels))


def _alike(one: Answer, other: Answer) -> bool:
    """Friction rests in the same way at the ends of two searches."""
    names = [one.question.model.parameters[i].name for i in one.question.free]
    apart = (np.abs(one.p - other.p)[list(one.question.free)] / one.question.typical).tolist()
    return all(gap < SAME for name, gap in zip(names, apart, strict=True) if name in STUCK)


def widened(base: Candidate, data: Data) -> Candidate | None:
    """The base model with the bounds of the [fit] table lifted to the plant's own; ``None`` if none was reached."""
    rig, p = base.rig, base.answer.p
    own = {parameter.name: parameter.bounds for parameter in rig.model.parameters}
    at = {f.name: float(p[rig.model.index(f.name)]) for f in rig.freed}
    edge = {
        f.name for f in rig.freed
        if min(at[f.name] - f.low, f.high - at[f.name]) <= 1e-6 * max(abs(at[f.name]), f.high - f.low)
        and (f.low, f.high) != own[f.name]
    }  # fmt: skip
    if not edge:
        return None
    freed = tuple(
        replace(f, low=own[f.name][0], high=own[f.name][1]) if f.name in edge else f for f in rig.freed
    )
    wide = replace(rig, freed=freed)
    rough = refitted(wide, (), base, data, rig.model)
    if excess(rough.judged, data.noise) > ABOUT * EXCESS:
        return rough  # more is missing than the last units of likelihood would close
    return settled((), wide, rough.answer.p, rough.answer, data, rig.model)


def refitted(base: Rig, effects: tuple[Effect, ...], near: Candidate, data: Data, plain: Model) -> Candidate:
    """A model with these effects, refitted from what a similar one found: as well as needed to compare the two."""
    values = {
        name: float(near.answer.p[near.rig.model.index(name)])
        for name in (q.name for q in near.rig.model.parameters)
    }
    own = {
        name: value
        for effect in effects
        for name in (f"{effect.name}.{q.name}" for q in effect.parameters)
        if (value := values.get(name)) is not None
    }
    rig = with_effects(base, effects, own) if effects else base
    model = rig.model
    p = model.vector(rig.parameters)
    for i, parameter in enumerate(model.parameters):
        p[i] = values.get(parameter.name, p[i])
    question = data.question(rig, plain)
    levels = near.answer.noise.levels
    answer = maximise(question, p, levels, iterations=QUICK, polish=False, near=near.answer)
    rig, answer = centred(effects, rig, answer)
    return Candidate(effects, rig, answer, judge(answer, data.holdout))


def settled(
    effects: tuple[Effect, ...], rig: Rig, p: np.ndarray, near: Answer | None, data: Data, plain: Model
) -> Candidate:
    """The likeliest model from a start, judged; the process noise of `near`, if any, is where the search begins."""
    question = data.question(rig, plain)
    answer = maximise(question, p, None if near is None else near.noise.levels, near=near)
    rig, answer = centred(effects, rig, answer)
    return Candidate(effects, rig, answer, judge(answer, data.holdout))


def centred(effects: Sequence[Effect], rig: Rig, answer: Answer) -> tuple[Rig, Answer]:
    """A model with what its recordings together tell of effects of which each has something of its own."""
    model, problem = answer.question.model, answer.question.problem
    ends = answer.filtered.states[0][problem.begins + problem.counts]
    told: dict[str, float] = {}
    for effect in effects:
        own = f"{effect.name}."
        shown = {
            s.name.removeprefix(own): ends[:, i] for i, s in enumerate(model.states) if s.name.startswith(own)
        }
        values = {q.name: float(answer.p[model.index(own + q.name)]) for q in effect.parameters}
        told |= effect.qualified(effect.centred(values, shown))
    p = answer.p.copy()
    for name, value in told.items():
        p[model.index(name)] = np.clip(value, *model.parameters[model.index(name)].bounds)
    typical = np.array([q.typical for q in model.parameters])
    if not told or np.abs((p - answer.p) / typical).max() < MOVED:
        return rig, answer
    rig = replace(rig, parameters={**rig.parameters, **{name: float(p[model.index(name)]) for name in told}})
    # No search from there: it would only wander to where the recordings' own states allow as well.
    place = Place(replace(answer.question, rig=rig), p, answer.noise)
    place.differentiate()
    return rig, place.answer(answer.settled)
