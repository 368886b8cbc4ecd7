"""Where effects lead from afar: a race by what short windows miss, each model by the gains of its own filter.

A fitted model that lacks something large has bent its parameters and its process noise to make up for it: no small
change from there shows what is missing, and prediction from sample to sample hardly errs. Over a tenth of a second in
which nothing is corrected a wrong law adds up and noise cannot stand in for it; yet that is short enough for even
parameters that are far off to show the way. An effect that is at work soon misses a fraction of what others do.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from optid.core.model import Array, Model
from optid.core.threads import together
from optid.diagnosis.candidate import Candidate, Data
from optid.diagnosis.disturbance import Located
from optid.diagnosis.judge import EXCESS, excess, judge
from optid.diagnosis.lead import Ground, Lead, ahead, worst, worthy
from optid.diagnosis.resemblance import resembling
from optid.diagnosis.screen import Signature
from optid.effects.effect import Effect
from optid.errors import SolveError
from optid.estimation.likelihood import Filtered, Noise, deviance, huber, run_filter
from optid.estimation.multistep import windows
from optid.estimation.place import LEVELS, Answer, Place, Question
from optid.estimation.problem import Booleans
from optid.estimation.scoring import middling
from optid.estimation.steering import Steered, innovations, steered_fit

SHORT = 0.2  # of the windows that models are judged by
CALM = 2.0  # log: by how much less process noise than a middling one the filters have
# The race: steps of each lead, how many go on, and how many of one effect. The first leg, and the look before it at
# every branch of every effect, which the filter of the model without them leads, run over the recording in which most
# is missing, those that are left over all.
BEGUN, OF_ONE = 32, 2
RACE = ((2, 12, 2), (3, 5, 1), (4, 5, 1))
# Of effects that are worth it, how many branches together are brought on if what the race found leaves something: they
# end on tops of their own, and which is the highest shows only there. It ends where so many in a row miss hardly less
# than the best. The legs of each, over all recordings: by short windows, or whole ones, so many steps.
BRANCHES, PATIENCE, HIGHER = 6, 2, 0.05
TO_ONE_TOP = ((True, 3), (True, 4))
TO_ITS_END = ((False, 4), (False, 4))


def from_afar(
    current: Candidate,
    guide: Answer,
    effects: Sequence[Effect],
    data: Data,
    plain: Model,
    *,
    near: Mapping[str, Located] | None = None,
    race: Sequence[tuple[int, int, int]] = RACE,
) -> list[Signature]:
    """What effects gain where they lead, the most promising first.

    They begin where the guide stands and, as that may be bent, at the rig file's values; beside other effects only
    where the guide stands, which is about where all of them belong. Effects of a sensor begin where an unknown signal
    there stands, too, which they resemble.

    Args:
        current: the model that they come to.
        guide: of the same model.
        effects: to try.
        data: recordings.
        plain: the model as it came.
        near: unknown signals by site that were estimated beside that model. If given, effects begin where the guide
            stands and, at these sites, where the signal does, and no branch is brought on but what the race found.
        race: its legs, as in RACE.
    """
    q = guide.question
    starts = (
        [guide.p]
        if near is not None or current.effects
        else [guide.p, q.model.vector(current.rig.parameters)]
    )
    seconds, first = current.judged.horizon, worst(guide)
    looks, whole = windows(q.problem, SHORT * seconds), windows(q.problem, seconds)
    names = tuple(parameter.name for parameter in q.model.parameters)
    begun: list[Lead] = []
    running: list[Lead] = []
    for start in starts:
        held = _filter(q, start, first)
        if held is not None:
            ground = Ground.of(current.rig, guide, data, plain, start, held, first, looks)
            there = [lead for effect in effects if not data.over for lead in ground.begun(effect)]
            begun += there
            running += ahead(there, BEGUN, OF_ONE)
    resembled = [
        _seen(Lead(effect, question, names, Steered(p, math.inf)), first, looks)
        for effect, question, p in resembling(current, effects, data, plain, near)
    ]
    begun += resembled
    running += resembled

    def further(lead: Lead, steps: int, over: Sequence[int] | None) -> Lead:
        return _lost(lead) if data.over else _further(lead, steps, over, looks)

    for leg, (steps, most, alike) in enumerate(race):
        if data.over:
            return []
        on = partial(further, steps=steps, over=None if leg else first)
        running = ahead(together(on, running), most, alike)
    alone = _alone(guide, looks, whole)
    found = worthy(running, alone[0], guide)

    def best(signature: Signature) -> Lead:
        lead = next(one for one in running if one.effect is signature.effect)
        branches = [] if near is not None else [one for one in begun if one.effect is lead.effect]
        others = ahead(branches, BRANCHES // len(found), BRANCHES)
        return _best(lead, others, looks, whole, data)

    return worthy(ahead(together(best, found), len(found), 1), alone[1], guide)


def _seen(lead: Lead, over: Sequence[int], looks: Booleans) -> Lead:
    """The same with what its own filter leaves of the innovations, over the recording that is looked at first."""
    held = _filter(lead.question, lead.at.p, over)
    if held is None:
        return _lost(lead)
    (z,) = innovations(lead.question, lead.at.p[None], lead.question.model, held, over, looks)
    return replace(lead, at=Steered(lead.at.p, float(huber(z).sum())))


def _lost(lead: Lead) -> Lead:
    return replace(lead, at=Steered(lead.at.p, math.inf))


def _best(lead: Lead, others: Sequence[Lead], looks: Booleans, whole: Booleans, data: Data) -> Lead:
    """Where an effect led, brought to its end by whole windows; by other branches too, if that leaves something."""
    best, lower = _brought(lead, TO_ITS_END, looks, whole), 0
    for other in others:
        if data.over or lower == PATIENCE or (lower == 0 and _arrived(best, data)):
            break
        there = _brought(other, TO_ONE_TOP + TO_ITS_END, looks, whole)
        lower = 0 if there.at.loss < (1.0 - HIGHER) * best.at.loss else lower + 1
        best = min(best, there, key=lambda one: one.at.loss)
    return best


def _brought(lead: Lead, legs: Sequence[tuple[bool, int]], looks: Booleans, whole: Booleans) -> Lead:
    for short, steps in legs:
        lead = _further(lead, steps, None, looks if short else whole)
    return lead


def _arrived(lead: Lead, data: Data) -> bool:
    """Its windows held out are at the noise."""
    here = Place(lead.question, lead.at.p, calm(lead.question))
    if not math.isfinite(here.score):
        return False
    here.glance()
    return excess(judge(here.answer(False), data.holdout), data.noise) <= EXCESS


def calm(q: Question) -> Noise:
    """Process noise so small that what is missing is not taken for it, and filters still hold models to the data."""
    return Noise(q.measurement, q.groups, np.maximum(middling(q) - CALM, LEVELS[0]))


def _filter(q: Question, p: Array, over: Sequence[int] | None = None) -> Filtered | None:
    """The calm filter, the measurement's own variances in it; ``None`` where the model leaves the numbers."""
    noise = calm(q)
    Q = noise.spectrum(len(q.model.states))[None]
    f = run_filter(q.model, q.problem, p[None], Q, noise.measurement[None], keep=True, only=over)
    if not math.isfinite(float(deviance(f.innovations, f.variances).sum())):
        return None
    return replace(f, variances=np.broadcast_to(noise.measurement, f.variances.shape))


def _further(lead: Lead, steps: int, over: Sequence[int] | None, looks: Booleans) -> Lead:
    held = _filter(lead.question, lead.at.p, over)
    if held is None:
        return _lost(lead)
    return lead.further(lead.question.model, held, steps, over, looks)


def _alone(guide: Answer, looks: Booleans, whole: Booleans) -> tuple[float, float]:
    """What short windows and whole ones of the model without any of the effects miss, as far as it gets."""
    q = guide.question
    p, found = guide.p, []
    for legs in (TO_ONE_TOP, TO_ITS_END):
        loss = math.inf
        for short, steps in legs:
            held = _filter(q, p)
            if held is not None:
                with contextlib.suppress(SolveError):
                    p, loss = steered_fit(q, p, q.model, held, steps, looks=looks if short else whole)
        found.append(loss)
    return found[0], found[1]
