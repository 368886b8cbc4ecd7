"""Settling a model: by its windows to a likelier top or to what they ask for, and by a plain start.

Likelihood with process noise has many tops; from one of them no step of scoring shows the next. Windows see what adds
up over half a second and lead past it. Where a law's form is not nature's the likeliest parameters may predict far
worse than others do: then those that predict the recordings to fit are taken, and how far the two are apart is in the
intervals. What is judged by simulation from end to end is left as it is.
"""

from __future__ import annotations

import contextlib
from dataclasses import replace

import numpy as np

from optid.core.model import Array
from optid.diagnosis.candidate import ABOUT, Candidate, Data, stuck, unskewed, yielding_least
from optid.diagnosis.judge import EXCESS, excess, judge
from optid.diagnosis.uncertainty import FEWEST, jackknife
from optid.errors import SolveError
from optid.estimation.multistep import foreseeing, misses, misses_unseen, preferable
from optid.estimation.place import Answer
from optid.estimation.scoring import ENOUGH, maximise, standing

STANDING = 6  # iterations with calmer states, in which parameters find their place
CALMER = 1.25  # log: by how much less process noise
LESS = 0.02  # of what windows miss: the likeliest parameters stay where others miss no less than that


def likelier(found: Candidate, data: Data) -> Candidate:
    """The same model at a likelier top, if its windows err beyond the noise and lead to one."""
    if excess(found.judged, data.noise) <= EXCESS or data.misfit is not None or data.over:
        return found
    answer = _asked(found, data)
    seconds = found.judged.horizon
    led = foreseeing(answer, seconds)
    if led is answer:
        return found
    with contextlib.suppress(SolveError):  # so little process noise may not hold the model to the data
        quiet = standing(led.question, led.p, led.noise.levels - CALMER, STANDING)
        other = maximise(led.question, quiet.p, quiet.noise.levels)
        if other.score < found.answer.score - ENOUGH and preferable(other, led, seconds) is other:
            return _with(found, other, data)
    return found


def plainer(found: Candidate, data: Data) -> Candidate:
    """The same model, where it is likelier from a plain start: a rigid contact, no skew, laws at their simplest.

    While physics was missing, whatever may bend stood in for it, and along a ridge of the likelihood it may hold on to
    that: a second lag of a sensor against the skew of a card, a contact that yields against a lag. Process noise stood
    in for it as well, and as much of it would not show the way.
    """
    if data.misfit is not None or data.over:
        return found
    question = yielding_least(_asked(found, data).question)
    simple: dict[str, float] = {}
    for effect in found.effects:
        simple |= effect.qualified(effect.simplest)
    p = unskewed(question, stuck(question, found.answer.p))
    for name, value in simple.items():
        p[question.model.index(name)] = value
    with contextlib.suppress(SolveError):  # so rigid a contact may leave the numbers
        other = maximise(question, p, found.answer.noise.levels - CALMER)
        if other.score < found.answer.score - ENOUGH:
            return _with(found, other, data)
    return found


def rigidly(found: Candidate, data: Data) -> tuple[Candidate, Data]:
    """A model that errs little from a plain start, if nothing shows to be missing so, and data for rivals as rigid.

    Beside its top it has something to give that an effect which is not there would take: while a contact yielded it may
    have bent to what another would straighten. What leaves something still stays, and so do the data.
    """
    if excess(found.judged, data.noise) > ABOUT * EXCESS:
        return found, data
    plain = plainer(found, data)
    if plain is found or excess(plain.judged, data.noise) > EXCESS:
        return found, data
    return plain, replace(data, rigid=True)


def foreseen(found: Candidate, data: Data) -> tuple[Candidate, Array]:
    """The model with the parameters that predict windows of the recordings to fit best, where that matters.

    What is gained on recordings that had no say in them counts: all together would gain by any misfit of one of them.
    Whether windows err beyond the noise does not matter: what their pasts leave open is no reason to predict worse than
    the same law can.

    Returns:
        The model, and the least half-widths of its intervals, (free,), SI: how far the likeliest parameters are, and
        how far windows of single recordings disagree, if there are enough to tell.
    """
    none = np.zeros(len(found.answer.question.free))
    if data.misfit is not None:
        return found, none
    answer, seconds = _asked(found, data), found.judged.horizon
    led = foreseeing(answer, seconds)
    if led is answer:
        return found, none
    missed, without = misses_unseen(led, seconds)
    if missed > (1.0 - LESS) * misses(answer, seconds):
        return found, none
    free = list(answer.question.free)
    apart = np.abs(led.p - answer.p)[free]
    if len(without) >= FEWEST:
        apart = np.maximum(apart, jackknife([p[free] for p in without]))
    return _with(found, led, data), apart


def _asked(found: Candidate, data: Data) -> Answer:
    """The answer, to a question that has as long as these data."""
    return replace(found.answer, question=replace(found.answer.question, until=data.until))


def _with(found: Candidate, answer: Answer, data: Data) -> Candidate:
    return replace(found, answer=answer, judged=judge(answer, data.holdout))
