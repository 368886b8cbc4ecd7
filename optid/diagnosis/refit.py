"""A round's refits: the effects that a screen found promising compete by likelihood, and what is held out decides."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from optid.core.model import Array
from optid.diagnosis.afar import calm
from optid.diagnosis.candidate import ABOUT, QUICK, SCANNED
from optid.diagnosis.contest import (
    Contest,
    Refitted,
    Rival,
    alike,
    foremost,
    level,
    misfit,
    order,
    reason,
    rival_of,
)
from optid.diagnosis.judge import EXCESS, excess, judge
from optid.diagnosis.screen import Signature, grown
from optid.effects.effect import Effect
from optid.errors import SolveError
from optid.estimation.multistep import foreseeing, preferable
from optid.estimation.place import Answer, Place, Question
from optid.estimation.scoring import NEARBY, likeliest, maximise, middling
from optid.estimation.steering import STEPS, steered_fit

FIRST = 4  # iterations that show which refits are worth more
FAINT = 0.03  # of a signature's strength
AGAIN = (0.5, 2.0)  # the same, where a refit from the whole of it ends at next to nothing
SIZES = (0.5, 1.0, 1.6, 2.5)  # the same, beside parameters that have found where they belong
NEAR = 0.8  # of the best gain: a refit below this share does not go on
ALIKE = 0.3  # the same for an effect that is easily confused with the best: it may only have lost its way
# Of the best confirmed gain before: a refit from afar below this share is not on its way to more.
COMING = 0.5
# Of the best gain: first refits leave up to a tenth, and rivals nearer than that are taken further.
CLOSE = 0.9
# Of the smallest size worth a name: what a screen or a first refit leaves below it is not followed.
TINY = 0.25


def refit(c: Contest, few: Sequence[Signature], before: Sequence[Rival] = ()) -> list[Rival]:
    """Refits of the few most promising, best first; a rival without a reason against it may win.

    Rivals of an earlier look, `before`, compete with them; an effect that both have is the likelier of the two.
    """
    tried: list[Refitted] = []
    whole: list[Refitted] = []
    for signature in few:
        if whole and not any(alike(signature.effect, t.effect) for t in whole):
            continue  # one explains all there is: only what resembles it could do as well
        if c.data.over:
            break
        c.tell(f"trying {signature.effect.name}")
        with contextlib.suppress(SolveError):  # with this effect the model may leave the numbers at once
            tried.append(_attempt(c, signature, again=signature is few[0]))
            if _explains_all(c, tried[-1]):
                whole.append(tried[-1])
    tried.sort(key=lambda t: t.answer.score)
    _follow(c, tried, max((rival.train_gain for rival in before if not rival.why), default=0.0))
    rivals = [rival_of(c, t, place) for place, t in enumerate(tried)]
    first = min(range(len(tried)), key=lambda place: order(rivals[place]), default=None)
    # Where much is missing still, more than the last units of likelihood would close is left open.
    if (
        first is not None
        and not rivals[first].why
        and excess(rivals[first].candidate.judged, c.data.noise) <= EXCESS
    ):
        _settle(c, tried[first])
        rivals[first] = rival_of(c, tried[first], first)
    likeliest_of: dict[str, Rival] = {}
    for rival in sorted([*before, *rivals], key=lambda one: -round(one.train_gain)):
        likeliest_of.setdefault(rival.effect.name, rival)
    both = list(likeliest_of.values())
    if before:  # they take their turns together
        both = [replace(rival, why=reason(c, rival, level(place))) for place, rival in enumerate(both)]
    return foremost(sorted(both, key=order))


def _start_again(c: Contest, tried: list[Refitted]) -> list[Refitted]:
    """Second starts for the look-alikes of the best that fell behind it, from where the best stands; who gained by it.

    They may have lost their way, which is: to much process noise and next to no effect.
    """
    if not tried or c.guide is c.current.answer:  # there is no other look than the one that led here
        return []
    best, again = tried[0], []
    gain = c.current.answer.score - best.answer.score
    if misfit(best, gain, c.screened):
        return []
    for t in tried:
        if (
            not c.data.over
            and alike(t.effect, best.effect)
            and c.current.answer.score - t.answer.score < ALIKE * gain
        ):
            c.tell(f"starting again with {t.effect.name}")
            with contextlib.suppress(SolveError):
                other = _beside(c, t, best, goal=c.current.answer.score - ALIKE * gain)
                if other.score < t.answer.score:
                    t.answer = other
                    again.append(t)
    tried.sort(key=lambda t: t.answer.score)
    return again


def _explains_all(c: Contest, t: Refitted) -> bool:
    """The windows held out are at the noise; the model's own imperfection is dear, and looked at only near there."""
    judged = judge(t.answer, c.data.holdout)
    near = all(s.rmse <= ABOUT * c.data.noise.get(role, 0.0) for role, s in judged.scores.items())
    return near and excess(judged, c.data.noise) <= EXCESS


def _beside(c: Contest, t: Refitted, best: Refitted, goal: float) -> Answer:
    """From the parameters and the process noise that the best of the round found, at the likeliest of some sizes.

    It ends where a `goal`, without which it is not followed further, falls out of reach.
    """
    question, levels = t.answer.question, best.answer.noise.levels
    starts = [
        (placed(c, question, t.effect.qualified(_scaled(t.effect, t.values, much)), best.answer), levels)
        for much in SIZES
    ]
    start = likeliest(question, starts)
    return maximise(question, *start, iterations=QUICK, polish=False, near=t.answer, goal=goal)


def _follow(c: Contest, tried: list[Refitted], before: float) -> None:
    """Bring the best of the first refits further, and once more those that then are close together.

    Where they leave something, their look-alikes start again in between. Those that come far short of the best
    confirmed gain `before` are left.
    """
    here = c.current.answer.score
    _further(c, tried, before, tried)
    if tried and not _explains_all(c, tried[0]):
        _further(c, tried, before, _start_again(c, tried))
    gains = [here - t.answer.score for t in tried]
    for t, gain in zip(tried, gains, strict=True):
        if gain > max(CLOSE * max(gains), COMING * before) and t.size > TINY and not c.data.over:
            c.tell(f"refitting further with {t.effect.name}")
            at, levels = t.answer.p, t.answer.noise.levels
            found = maximise(t.answer.question, at, levels, polish=False, rough=NEARBY, near=t.answer)
            t.answer = _chosen(c, found, t.answer)
    tried.sort(key=lambda t: t.answer.score)


def _further(c: Contest, tried: list[Refitted], before: float, whom: Sequence[Refitted]) -> None:
    """Bring on those of the best for `whom` it is asked, by prediction over windows and then by likelihood."""
    here = c.current.answer.score
    gains = [here - t.answer.score for t in tried]
    for place, (t, gain) in enumerate(zip(tried, gains, strict=True)):
        twin = alike(t.effect, tried[0].effect)
        near = place < (3 if twin else 2) and gain > (ALIKE if twin else NEAR) * gains[0]
        near = near and gain > COMING * before and any(t is one for one in whom)
        if near and t.size > TINY and not c.data.over:
            c.tell(f"refitting with {t.effect.name}")
            led = foreseeing(t.answer, c.current.judged.horizon)
            goal = here - CLOSE * max(here - other.answer.score for other in tried)
            at, levels = led.p, led.noise.levels
            found = maximise(led.question, at, levels, iterations=QUICK, polish=False, near=led, goal=goal)
            t.answer = _chosen(c, min(t.answer, found, key=lambda one: one.score), led)
    tried.sort(key=lambda t: t.answer.score)


def _settle(c: Contest, t: Refitted) -> None:
    c.tell(f"settling {t.effect.name}")
    found = maximise(t.answer.question, t.answer.p, t.answer.noise.levels, near=t.answer)
    t.answer = _chosen(c, found, t.answer)


def _attempt(c: Contest, signature: Signature, again: bool) -> Refitted:
    """A first refit from where the screen would have the effect, or from where it led.

    The most promising is tried `again` if that loses it: from other sizes, or longer.
    """
    effect, values = signature.effect, signature.values
    question = posed(c, signature)
    rig = question.rig
    if signature.beside:
        led = {**signature.beside, **effect.qualified(values)}
        answer = _from_afar(c, question, led)
        if again and answer.score > c.current.answer.score:  # the way is long: it has not arrived yet
            answer = maximise(
                question, answer.p, answer.noise.levels, polish=False, rough=NEARBY, near=answer
            )
        return Refitted(effect, rig, answer, values)
    best = Refitted(effect, rig, _started(c, question, effect, values), values)
    if again and effect.size(values) >= 1.0 > best.size:
        for factor in AGAIN:
            with contextlib.suppress(SolveError):
                other = _started(c, question, effect, _scaled(effect, values, factor))
                best.answer = min(best.answer, other, key=lambda answer: answer.score)
    return best


def posed(c: Contest, signature: Signature) -> Question:
    """What the recordings are asked of the current model with one more effect, from where that is seen."""
    rig = grown(c.current.rig, signature.effect)
    own = signature.effect.qualified(signature.values)
    return c.data.question(replace(rig, parameters={**rig.parameters, **own}), c.base.rig.model)


def _started(c: Contest, question: Question, effect: Effect, values: Mapping[str, float]) -> Answer:
    """By the gains of the guide, which may move the states less than the current model's, then a rough refit."""
    here = c.current.answer
    p = placed(c, question, effect.qualified(values), here)
    # A trace of it is as likely as none, wherever the screen would have led.
    faint = placed(c, question, effect.qualified(_scaled(effect, values, FAINT)), here)
    starts = [(p, here.noise.levels), (faint, here.noise.levels)]
    with contextlib.suppress(SolveError):  # it holds on to the data by more noise than the guide allows
        led = steered_fit(question, p, c.guide.question.model, c.guide.filtered, STEPS).p
        starts += [(led, here.noise.levels - by) for by in SCANNED]
    best = likeliest(question, starts)
    # The guide's derivatives are a start, but not its score: with less noise than suits the model that is far off.
    return maximise(
        question, *best, iterations=FIRST, polish=False, near=c.guide, since=here.score, glances=True
    )


def _from_afar(c: Contest, question: Question, led: Mapping[str, float]) -> Answer:
    """From where windows led an effect, all parameters of it by name: a rough refit, unless it leads astray again.

    Raises:
        SolveError: the model cannot be simulated where it led.
    """
    here = Place(question, question.at(led), calm(question))
    if not math.isfinite(here.score):
        raise SolveError("the model leaves the numbers where its effect led")
    here.glance()
    near = foreseeing(here.answer(False), c.current.judged.horizon)
    # Where the current model is far from there, it is likelier than that at first, by its process noise.
    levels = [at - by for at in (c.current.answer.noise.levels, middling(question)) for by in SCANNED]
    best = likeliest(question, [(near.p, at) for at in (near.noise.levels, *levels)])
    found = maximise(question, *best, iterations=QUICK, polish=False)
    return _chosen(c, found, near)


def _chosen(c: Contest, likely: Answer, led: Answer) -> Answer:
    """The likelier of two, unless it leads astray from where windows led and that gains as well."""
    return likely if led.score > c.current.answer.score else preferable(likely, led, c.current.judged.horizon)


def placed(c: Contest, question: Question, values: Mapping[str, float], source: Answer) -> Array:
    """All parameters of a question: the current model's as `source` has them, and an effect's `values`."""
    other = source.question.model
    stands = {q.name: float(source.p[other.index(q.name)]) for q in c.current.rig.model.parameters}
    return question.at({**stands, **values})


def _scaled(effect: Effect, values: Mapping[str, float], factor: float) -> dict[str, float]:
    """The same effect of another strength."""
    null = effect.at_null()
    return {
        name: null[name] + factor * (value - null[name]) if name in effect.strength else value
        for name, value in values.items()
    }
