"""A round's refits: the effects that a screen found promising compete by likelihood, and what is held out decides."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from scipy import stats

from optid.core.model import Array
from optid.diagnose.candidate import ABOUT, QUICK, SCANNED, Candidate, Data, centred
from optid.diagnose.judge import EXCESS, Comparison, brought_to_noise, cleared, compare, excess, judge
from optid.diagnose.screen import Signature, grown
from optid.effects.effect import Effect
from optid.errors import SolveError
from optid.fit.multistep import foreseeing
from optid.fit.place import Answer, Question
from optid.fit.scoring import NEARBY, likeliest, maximise, middling, standing
from optid.fit.steering import steered_fit
from optid.rigs.rigfile import Rig

LEVEL = 0.01  # of false alarms on a rig that lacks nothing, for the whole catalogue together
WORTH = 0.04  # share by which an effect must lower the windows' error on the hold-out (physics catalogue B.3, step 5)
# Of the squared error that the plain model began with, what an effect beside others must clear: true laws follow those
# of the catalogue within a tenth or two of their size. One that brings the windows to the noise need not: what the
# form of other laws leaves has no reason to end just there.
FORM = 0.02
# ... and one that clears most of what the laws before it left need not either: what their form leaves has no reason to
# look like another law.
MOST = 0.5
FIRST = 4  # iterations that show which refits are worth more
FAINT = 0.03  # of a signature's strength
AGAIN = (0.5, 2.0)  # the same, where a refit from the whole of it ends at next to nothing
SIZES = (0.5, 1.0, 1.6, 2.5)  # the same, beside parameters that have found where they belong
NEAR = 0.8  # of the best gain: a refit below this share does not go on
ALIKE = 0.3  # the same for an effect that is easily confused with the best: it may only have lost its way
COMING = (
    0.5  # of the best confirmed gain before: a refit from afar below this share is not on its way to more
)
SAME = 0.25  # share by which own values differ at most where a refit stands where its effect leads from afar
CLOSE = (
    0.9  # of the best gain: first refits leave up to a tenth, and rivals nearer than that are taken further
)
TINY = (
    0.25  # of the smallest size worth a name: what a screen or a first refit leaves below it is not followed
)


@dataclass(frozen=True, eq=False)
class Rival:
    """An effect that was refitted in a round: against the model of that round, and why it was not taken.

    `hopeful` says that it fits the recordings it was given, whatever those held out say.
    """

    effect: Effect
    candidate: Candidate
    train_gain: float
    against: Comparison
    why: str
    hopeful: bool


@dataclass(frozen=True, eq=False)
class Contest:
    """What the refits of a round have in common.

    Attributes:
        base, current: the model before any effect, and the one that the round goes from.
        guide: whose filter's gains lead first refits.
        screened: how many effects the screen saw.
        data: recordings.
        tell: is told what is being done.
    """

    base: Candidate
    current: Candidate
    guide: Answer
    screened: int
    data: Data
    tell: Callable[[str], None]


@dataclass(eq=False)
class Refitted:
    """An effect on its way through a round: `values` is where the screen would have it, SI, by own name."""

    effect: Effect
    rig: Rig
    answer: Answer
    values: Mapping[str, float]

    @property
    def size(self) -> float:
        """In smallest sizes worth a name."""
        return self.effect.size(own_values(self.effect, self.rig, self.answer))


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
    for rival in sorted([*before, *rivals], key=lambda one: -one.train_gain):
        likeliest_of.setdefault(rival.effect.name, rival)
    both = list(likeliest_of.values())
    if before:  # they take their turns together
        both = [replace(rival, why=_reason(c, rival, place)) for place, rival in enumerate(both)]
    return _foremost(sorted(both, key=order))


def _foremost(rivals: list[Rival]) -> list[Rival]:
    """The best first, once one is confirmed: then something is missing, and who explains more of it takes the lead.

    That is one that fits better what it was given and predicts better what was held out, by likelihood and by error,
    though few windows may carry its gain: too few for the test that has been passed already.
    """
    if not rivals or rivals[0].why:
        return rivals
    won = rivals[0]
    better = [r for r in rivals[1:] if r.hopeful and r.why and _surpasses(r, won)]
    if not better:
        return rivals
    lead = max(better, key=lambda r: r.train_gain - cost(r.effect))
    return [replace(lead, why=""), *(r for r in rivals if r is not lead)]


def _surpasses(one: Rival, other: Rival) -> bool:
    return (
        one.train_gain - cost(one.effect) > other.train_gain - cost(other.effect)
        and one.against.bounded_gain > other.against.bounded_gain
        and one.against.error_gain > other.against.error_gain
    )


def _start_again(c: Contest, tried: list[Refitted]) -> list[Refitted]:
    """Second starts for the look-alikes of the best that fell behind it, from where the best stands; who gained by it.

    They may have lost their way, which is: to much process noise and next to no effect.
    """
    if not tried or c.guide is c.current.answer:  # there is no other look than the one that led here
        return []
    best, again = tried[0], []
    gain = c.current.answer.score - best.answer.score
    if _misfit(best, gain, c.screened):
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
            t.answer = maximise(t.answer.question, at, levels, polish=False, rough=NEARBY, near=t.answer)
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
            t.answer = min(t.answer, found, key=lambda answer: answer.score)
    tried.sort(key=lambda t: t.answer.score)


def _settle(c: Contest, t: Refitted) -> None:
    c.tell(f"settling {t.effect.name}")
    t.answer = maximise(t.answer.question, t.answer.p, t.answer.noise.levels, near=t.answer)


def rival_of(c: Contest, t: Refitted, place: int) -> Rival:
    """A refitted effect against the model of its round, in its turn by likelihood."""
    effects = (*c.current.effects, t.effect)
    t.rig, t.answer = centred(effects, t.rig, t.answer)
    candidate = Candidate(effects, t.rig, t.answer, judge(t.answer, c.data.holdout))
    gain = c.current.answer.score - t.answer.score
    against = compare(c.current.judged, candidate.judged, c.data.generator)
    misfit = _misfit(t, gain, c.screened)
    rival = Rival(t.effect, candidate, gain, against, misfit, not misfit)
    return replace(rival, why=_reason(c, rival, place))


def _reason(c: Contest, rival: Rival, place: int) -> str:
    """Why a rival is not taken, in its turn by likelihood; empty if it may be."""
    if not rival.hopeful:
        return rival.why
    why = _unproven(rival.against, place)
    if why and rival.against.bounded_gain > 0.0:
        # What acts seldom shows in a window or two, too few for a test over windows.
        why = "" if brought_to_noise(c.current.judged, rival.candidate.judged, c.data.noise) else why
    if not why and c.current.effects:
        if excess(rival.candidate.judged, c.data.noise) > EXCESS:
            why = _formal(c, rival.candidate)
        elif excess(c.current.judged, c.data.noise) <= EXCESS:
            why = _unasked(c, rival.candidate)
    return why


def order(rival: Rival) -> tuple[bool, float]:
    """The best first, of two as good the one with fewer parameters; those with a reason against them last."""
    return bool(rival.why), cost(rival.effect) - rival.train_gain - rival.against.bounded_gain


def alike(one: Effect, other: Effect) -> bool:
    """Either is known to be easily confused with the other."""
    return one.name in other.look_alikes or other.name in one.look_alikes


def cost(effect: Effect) -> float:
    """What parameters gain by themselves in -2 log likelihood, as Schwarz's criterion has it."""
    return len(effect.fitted) * math.log(1e4)


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
        led = steered_fit(question, p, c.guide.question.model, c.guide.filtered, QUICK).p
        starts += [(led, here.noise.levels - by) for by in SCANNED]
    best = likeliest(question, starts)
    # The guide's derivatives are a start, but not its score: with less noise than suits the model that is far off.
    return maximise(
        question, *best, iterations=FIRST, polish=False, near=c.guide, since=here.score, glances=True
    )


def _from_afar(c: Contest, question: Question, led: Mapping[str, float]) -> Answer:
    """From where an effect led, all parameters of it by name: brought to stand there, then a rough refit.

    Where the current model is far from there, it is likelier than that at first, by its process noise.
    """
    p = placed(c, question, led, c.current.answer)
    near = standing(question, p, c.guide.noise.levels, FIRST).p
    levels = [at - by for at in (c.current.answer.noise.levels, middling(question)) for by in SCANNED]
    best = likeliest(question, [(near, at) for at in levels])
    return maximise(question, *best, iterations=QUICK, polish=False)


def placed(c: Contest, question: Question, values: Mapping[str, float], source: Answer) -> Array:
    """All parameters of a question: the current model's as `source` has them, and an effect's `values`."""
    model, other = question.model, source.question.model
    p = model.vector(question.rig.parameters)
    for parameter in c.current.rig.model.parameters:
        p[model.index(parameter.name)] = source.p[other.index(parameter.name)]
    for name, value in values.items():
        low, high = model.parameters[model.index(name)].bounds
        p[model.index(name)] = min(max(value, low), high)
    return p


def _scaled(effect: Effect, values: Mapping[str, float], factor: float) -> dict[str, float]:
    """The same effect of another strength."""
    null = effect.at_null()
    return {
        name: null[name] + factor * (value - null[name]) if name in effect.strength else value
        for name, value in values.items()
    }


def _misfit(t: Refitted, gain: float, screened: int) -> str:
    """Why a refitted effect does not even fit the recordings it was given; empty when it does."""
    needed = stats.chi2.isf(LEVEL / max(screened, 1), len(t.effect.fitted)) + cost(t.effect)
    if gain < needed:
        return f"the refit gains {gain:.0f} in -2 log likelihood where {needed:.0f} are needed"
    if t.size < 1.0:
        return f"the refit leaves it at {100 * t.size:.0f} % of the smallest size worth a name"
    return ""


def _unproven(against: Comparison, place: int) -> str:
    """What the recordings held out have against a refitted effect; empty when they confirm it.

    The refits take their turn by likelihood, and each turn has half of the hold-out's error rate that is left.
    """
    if against.p_value > LEVEL / 2 ** (place + 1):
        return f"no gain on the recordings held out (p = {against.p_value:.2g})"
    if against.error_gain < WORTH:
        return f"held out, windows err by {100 * max(against.error_gain, 0):.1f} % less: too little to matter"
    return ""


def _formal(c: Contest, candidate: Candidate) -> str:
    """Whether an effect beside others clears no more than the form of their laws may have left; empty if it does."""
    before = cleared(c.base.judged, c.current.judged, c.data.noise)
    more = cleared(c.base.judged, candidate.judged, c.data.noise) - before
    if more >= min(FORM, MOST * (1.0 - before)):
        return ""
    return f"it clears {100 * max(more, 0):.1f} % of the first error: the form of the laws before it may leave that"


def _unasked(c: Contest, candidate: Candidate) -> str:
    """Whether an effect leaves most of what the pasts of windows may explain as well; empty if it takes that away."""
    share = cleared(c.current.judged, candidate.judged, c.data.noise, imperfect=False)
    if share >= MOST:
        return ""
    return f"it clears {100 * max(share, 0):.0f} % of the error beyond the noise: where windows begin may explain that"


def arrived(rival: Rival, led: Signature) -> bool:
    """A confirmed rival has the values to which its effect leads from afar: a refit from there would end here."""
    if rival.why or rival.effect is not led.effect:
        return False
    own = own_values(rival.effect, rival.candidate.rig, rival.candidate.answer)
    return all(abs(own[n] - v) <= SAME * max(abs(own[n]), abs(v)) for n, v in led.values.items())


def own_values(effect: Effect, rig: Rig, answer: Answer) -> dict[str, float]:
    """The fitted values of an effect's parameters by own name, SI."""
    index = rig.model.index
    return {q.name: float(answer.p[index(f"{effect.name}.{q.name}")]) for q in effect.parameters}
