"""What else could stand where an effect was named: look-alikes refitted in its place, and who does as well.

In the round that found an effect a look-alike may have lost its way, or other effects that belong there were missing
yet. So in the end each that leads as far has its chance again, the rest of the model where the named one put it.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from optid.core.model import Model
from optid.core.threads import together
from optid.diagnosis.candidate import QUICK, Candidate, Data
from optid.diagnosis.contest import alike, cost, own_values
from optid.diagnosis.judge import Judged, compare, judge
from optid.diagnosis.lead import leads
from optid.diagnosis.screen import Signature, grown
from optid.diagnosis.search import Instead, Search
from optid.effects.effect import Effect
from optid.effects.library import admitted
from optid.errors import SolveError
from optid.estimation.likelihood import Noise
from optid.estimation.place import Answer, Place
from optid.estimation.scoring import NEARBY, likeliest, maximise
from optid.estimation.steering import TOLERANCE
from optid.rigs.rigfile import Rig, with_effects

NEAR = 0.5  # of the named effect's gain: a rough refit beyond it goes on
CLOSE = 0.98  # of the named effect's gain: what comes so near may take its place, and is settled
AS_GOOD = 0.9  # share of the named effect's gain in likelihood that a rival must reach
LEVEL = 0.05  # at which the hold-out must prefer the named one to tell them apart


def compared(found: Search, own: Sequence[Effect], data: Data, tell: Callable[[str], None]) -> Search:
    """Every effect against its look-alikes in its place; one that does better, as parameters count, takes it."""
    for effect in found.best.effects:
        tell(f"what else could stand in the place of {effect.name}")
        found = _with_better(found, effect, _instead(found, effect, own, data), data)
    return found


def indistinguishable(found: Search, effect: Effect, data: Data) -> tuple[str, ...]:
    """Names of what recordings and hold-out cannot tell from an effect, or from a part of it."""
    kept = {one.name for one in found.best.effects}
    names = [
        *_as_good_in_place(found, effect, data), *_sharing(found.best, effect), *_as_good_in_round(found, effect, data)
    ]  # fmt: skip
    return tuple(name for name in dict.fromkeys(names) if name not in kept)


def _as_good_in_place(found: Search, effect: Effect, data: Data) -> list[str]:
    least, best = found.without[effect.name].answer.score, found.best
    gain = least - best.answer.score
    return [
        other.effect.name
        for other, there in ((one, one.candidate) for one in found.instead.get(effect.name, ()))
        if other.level or _as_good(least - there.answer.score, there.judged, gain, best.judged, data)
    ]


def _as_good_in_round(found: Search, effect: Effect, data: Data) -> list[str]:
    """Of the first round that went on with it."""
    for one in found.rounds:
        mine = one.ahead
        if mine is not None and mine.effect.name == effect.name:
            return [
                rival.effect.name
                for rival in one.rivals
                if _as_good(
                    rival.train_gain, rival.candidate.judged, mine.train_gain, mine.candidate.judged, data
                )
            ]
    return []


def _sharing(best: Candidate, effect: Effect) -> list[str]:
    """Whose whole law a part of an effect is, where that part is large enough to matter."""
    own, null = own_values(effect, best.rig, best.answer), effect.at_null()
    return [
        name for part, name in effect.shares.items() if abs(own[part] - null[part]) >= effect.strength[part]
    ]


def _as_good(gain: float, rival: Judged, mine: float, named: Judged, data: Data) -> bool:
    return gain >= AS_GOOD * mine and compare(rival, named, data.generator).p_value > LEVEL


def _with_better(found: Search, effect: Effect, others: Sequence[Instead], data: Data) -> Search:
    """With the best of the others in the place of an effect, unless what is held out prefers that."""
    best, without = found.best, dict(found.without)
    here = Instead(effect, best, level=True)
    won = min([here, *others], key=lambda one: _price(one.candidate))
    if won is here or compare(won.candidate.judged, best.judged, data.generator).p_value <= LEVEL:
        return replace(found, instead={**found.instead, effect.name: tuple(others)})
    without[won.effect.name] = without.pop(effect.name)
    rest = (*(one for one in others if one is not won), replace(here, level=won.level))
    instead = {**found.instead, won.effect.name: rest}
    return replace(found, best=won.candidate, without=without, instead=instead)


def _price(candidate: Candidate) -> float:
    """-2 log likelihood with what the effects' parameters cost."""
    return candidate.answer.score + sum(cost(effect) for effect in candidate.effects)


def _instead(found: Search, effect: Effect, own: Sequence[Effect], data: Data) -> list[Instead]:
    """Models with a look-alike in the place of an effect, of those that lead about as far as it does."""
    base, best = found.base, found.best
    kept = {one.name for one in best.effects}
    rest = tuple(one for one in best.effects if one is not effect)
    rig = with_effects(base.rig, rest, {}) if rest else base.rig
    others = [one for one in admitted(rig.model, own) if alike(one, effect) and one.name not in kept]
    guide = _emptied(best, rig, data, base.rig.model) if others else None
    if guide is None:
        return []
    empty = Candidate(rest, rig, guide, best.judged)
    led = leads(empty, guide, [effect, *others], data, base.rig.model)
    mine = next((one.gain for one in led if one.effect is effect), math.inf)
    rows = int(np.isfinite(guide.filtered.innovations[0]).sum())

    def instead(led: Signature) -> Instead | None:
        with contextlib.suppress(SolveError):
            there = _in_place(found, effect, empty, led, data)
            return Instead(led.effect, there, led.gain > mine - TOLERANCE * rows)
        return None

    models = together(instead, [one for one in led if one.effect is not effect])
    return [model for model in models if model is not None]


def _emptied(best: Candidate, rig: Rig, data: Data, plain: Model) -> Answer | None:
    """The model of a rig with one effect less where the one with it stands; ``None`` if that is no model."""
    question = data.question(rig, plain)
    index = best.rig.model.index
    p = question.model.vector({one.name: best.answer.p[index(one.name)] for one in question.model.parameters})
    here = Place(question, p, Noise(question.measurement, question.groups, best.answer.noise.levels))
    if not math.isfinite(here.score):
        return None
    here.glance()
    return here.answer(False)


def _in_place(found: Search, effect: Effect, empty: Candidate, led: Signature, data: Data) -> Candidate:
    """A model with another effect in the place of one, as likely as it gets if it is near the named model."""
    rig, best = grown(empty.rig, led.effect), found.best.answer
    question = data.question(rig, found.base.rig.model)
    # Held gains hardly see how friction rests, and lead away from where the named model has it.
    stays = dict(zip((one.name for one in empty.rig.model.parameters), empty.answer.p.tolist(), strict=True))
    own, levels = led.effect.qualified(led.values), best.noise.levels
    starts = [
        (question.model.vector({**rig.parameters, **beside, **own}), levels) for beside in (stays, led.beside)
    ]
    least = found.without[effect.name].answer.score
    near, good, close = (least - share * (least - best.score) for share in (NEAR, AS_GOOD, CLOSE))
    answer = maximise(
        question, *likeliest(question, starts), iterations=QUICK, polish=False, since=best.score, goal=near
    )
    if answer.score < near:
        at, levels = answer.p, answer.noise.levels
        answer = maximise(question, at, levels, polish=False, rough=NEARBY, near=answer, goal=good)
    if answer.score < close:
        answer = maximise(
            question, answer.p, answer.noise.levels, near=answer, goal=best.score + cost(effect)
        )
    return Candidate((*empty.effects, led.effect), rig, answer, judge(answer, data.holdout))
