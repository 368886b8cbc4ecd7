"""Which effects are missing: added one at a time with a refit of everything, dropped again where idle.

A screen picks the few worth a refit; the refits compete by likelihood; recordings kept out of the refits decide. Where
two effects are missing either may need the other before it predicts better: one step may go ahead unconfirmed, and
counts only if the next one is confirmed and both turn out to be needed.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import stats

from optid.core.model import Model
from optid.diagnose.candidate import QUICK, QUIETER, SCANNED, Candidate, Data, Report, refitted, settled
from optid.diagnose.judge import EXCESS, Comparison, cleared, compare, excess, judge
from optid.diagnose.screen import Signature, screen
from optid.effects.effect import Effect
from optid.effects.library import admitted
from optid.errors import SolveError
from optid.fit.likelihood import WHOLE
from optid.fit.place import Answer, Question
from optid.fit.problem import pose
from optid.fit.scoring import followed, likeliest, maximise, question_of, quieted
from optid.fit.steering import steered_fit
from optid.rigs.rigfile import Rig, with_effects

LEVEL = 0.01  # of false alarms on a rig that lacks nothing, for the whole catalogue together
REFITS = 5  # candidates of a round
SECOND = 3  # candidates of a round that only the look at the fitted process noise brings in
DEEPEST = 3  # effects at most
WORTH = 0.04  # share by which an effect must lower the windows' error on the hold-out (physics catalogue B.3, step 5)
# Of the squared error that the plain model began with, what an effect beside others must clear: true laws follow those
# of the catalogue within a tenth or two of their size.
FORM = 0.02
FAINT = 0.03  # of a signature's strength
NEAR = 0.8  # of the best gain: a refit below this share does not go on
ALIKE = 0.3  # the same for an effect that is easily confused with the best: it may only have lost its way
CLOSE = 0.9  # of the best gain: first refits leave up to a tenth, and rivals nearer than that are settled
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
class Round:
    """One step of the search.

    Attributes:
        model: from which it went.
        screened: what the screen saw.
        rivals: who was refitted.
        winner: who was confirmed, if anyone.
        ahead: with whom the search went on, confirmed or not; ``None`` ends it.
    """

    model: Candidate
    screened: tuple[Signature, ...]
    rivals: tuple[Rival, ...]
    winner: Rival | None
    ahead: Rival | None


@dataclass(frozen=True, eq=False)
class Search:
    """How the search went.

    Attributes:
        base, best: the model before, and the one it ended with.
        rounds: every step.
        without: the best model without one of its effects, by that effect's name.
        dropped: effects that a later one made idle.
    """

    base: Candidate
    best: Candidate
    rounds: tuple[Round, ...]
    without: Mapping[str, Candidate] = field(default_factory=dict)
    dropped: tuple[Effect, ...] = field(default=())


def search(base: Candidate, own: Sequence[Effect], data: Data, report: Report) -> Search:
    """Add effects while held-out recordings confirm them."""
    plain, current, before, rounds = base.rig.model, base, base, []
    confirmed = base
    for depth in range(DEEPEST + 1):
        share = 0.1 + 0.8 * depth / (DEEPEST + 1)
        report(share, f"round {depth + 1}: screening the catalogue")
        effects = admitted(current.rig.model, own)
        signatures = screen(current.answer, data.train, effects)
        tight, guide = [], current.answer
        if excess(current.judged, data.noise) > EXCESS:
            # What is missing may hide in the process noise: look with less of it, too.
            guide = quieted(current.answer, QUIETER)
            tight = screen(guide, data.train, effects)
        few = _promising(signatures, tight)
        rivals = _refit(base, current, guide, few, len(signatures), data, report, share)
        winner = next((rival for rival in rivals if not rival.why), None)
        ahead = winner
        if winner is None and current is confirmed and depth + 1 < DEEPEST and tight:
            hopeful = [rival for rival in rivals if rival.hopeful]
            ahead = max(hopeful, key=lambda rival: rival.train_gain, default=None)
        rounds.append(Round(current, tuple(signatures), tuple(rivals), winner, ahead))
        if ahead is None or depth == DEEPEST:
            break
        before, current = current, ahead.candidate
        if winner is not None:
            confirmed = current
    best, without, dropped = _thinned(base, confirmed, before, data, plain, report)
    return Search(base, best, tuple(rounds), without, dropped)


def _promising(plain: Sequence[Signature], tight: Sequence[Signature]) -> list[Signature]:
    """What is worth a refit, of each look the best, an effect once."""
    few: dict[str, Signature] = {}
    for look, most in ((tight, REFITS), (plain, REFITS if not tight else SECOND)):
        gate = stats.chi2.isf(LEVEL / max(len(look), 1), 1)
        good = [s for s in look if s.gain > gate and s.effect.size(s.values) > TINY]
        for signature in good[:most]:
            few.setdefault(signature.effect.name, signature)
    return list(few.values())


def _refit(
    base: Candidate,
    current: Candidate,
    guide: Answer,
    few: Sequence[Signature],
    screened: int,
    data: Data,
    report: Report,
    share: float,
) -> list[Rival]:
    """Refits of the few most promising, best first; a rival without a reason against it may win."""
    tried = []
    for signature in few:
        report(share, f"trying {signature.effect.name}")
        rig = with_effects(current.rig, (signature.effect,), signature.effect.qualified(signature.values))
        with contextlib.suppress(SolveError):  # with this effect the model may leave the numbers at once
            first = _attempt(current, guide, signature, rig, data, base.rig.model)
            tried.append(_Refit(signature.effect, rig, first))
    tried.sort(key=lambda t: t.answer.score)
    _follow(tried, current, guide, report, share)

    def rival(place: int) -> Rival:
        t = tried[place]
        return _rival(t.effect, Candidate((*current.effects, t.effect), t.rig, t.answer, judge(t.answer, data.holdout)),
                      base, current, place, screened, data)  # fmt: skip

    rivals = _ranked([rival(place) for place in range(len(tried))])
    for place, t in enumerate(tried):
        if rivals and rivals[0].effect is t.effect and not t.settled and not rivals[0].why:
            _settle(t, report, share)
            rivals = _ranked([rival(place), *rivals[1:]])
            break
    return rivals


@dataclass(eq=False)
class _Refit:
    """An effect on its way through a round: roughly fitted, followed, settled."""

    effect: Effect
    rig: Rig
    answer: Answer
    settled: bool = False


def _follow(tried: list[_Refit], current: Candidate, guide: Answer, report: Report, share: float) -> None:
    """Bring the best of the first refits further, and settle those that then are close together."""
    here = current.answer.score
    gains = [here - t.answer.score for t in tried]
    for place, (t, gain) in enumerate(zip(tried, gains, strict=True)):
        alike = t.effect.name in tried[0].effect.look_alikes or tried[0].effect.name in t.effect.look_alikes
        near = place < (3 if alike else 2) and gain > (ALIKE if alike else NEAR) * gains[0]
        if near and _size(t.effect, t.rig, t.answer) > TINY:
            report(share, f"refitting with {t.effect.name}")
            start = followed(t.answer, guide.noise.levels, SCANNED)
            t.answer = maximise(t.answer.question, *start, iterations=QUICK, polish=False, near=t.answer)
    gains = [here - t.answer.score for t in tried]
    for t, gain in zip(tried, gains, strict=True):
        if gain > CLOSE * max(gains) and _size(t.effect, t.rig, t.answer) > TINY:
            _settle(t, report, share)
    tried.sort(key=lambda t: t.answer.score)


def _settle(t: _Refit, report: Report, share: float) -> None:
    report(share, f"settling {t.effect.name}")
    t.answer = maximise(t.answer.question, t.answer.p, t.answer.noise.levels, near=t.answer)
    t.settled = True


def _rival(
    effect: Effect, candidate: Candidate, base: Candidate, current: Candidate, place: int, screened: int,
    data: Data,
) -> Rival:  # fmt: skip
    """A refitted effect against the model of its round, in its turn by likelihood."""
    gain = current.answer.score - candidate.answer.score
    against = compare(current.judged, candidate.judged, data.generator)
    misfit = _misfit(effect, candidate, gain, screened)
    more = cleared(base.judged, candidate.judged, data.noise)
    if current.effects:
        more -= cleared(base.judged, current.judged, data.noise)
    why = misfit or _unproven(against, place) or _formal(current, more)
    return Rival(effect, candidate, gain, against, why, not misfit)


def _ranked(rivals: list[Rival]) -> list[Rival]:
    """The best first, of two as good the one with fewer parameters; those with a reason against them last."""
    return sorted(
        rivals, key=lambda r: (bool(r.why), _cost(r.effect) - r.train_gain - r.against.bounded_gain)
    )


def _cost(effect: Effect) -> float:
    """What parameters gain by themselves in -2 log likelihood, as Schwarz's criterion has it."""
    return len(effect.parameters) * math.log(1e4)


def _attempt(
    current: Candidate, guide: Answer, signature: Signature, rig: Rig, data: Data, plain: Model
) -> Answer:
    """A first refit from where the screen would have the effect; from its usual sizes, too, if that loses it."""
    question = question_of(rig, pose(rig.model, data.train, WHOLE), plain)
    effect = signature.effect
    best = _started(question, current, guide, effect, signature.values)
    if effect.size(signature.values) < 1.0 or _size(effect, rig, best) >= 1.0:
        return best
    for usual in effect.usual:
        with contextlib.suppress(SolveError):
            other = _started(question, current, guide, effect, {**signature.values, **usual})
            best = min(best, other, key=lambda answer: answer.score)
    return best


def _started(
    question: Question, current: Candidate, guide: Answer, effect: Effect, values: Mapping[str, float]
) -> Answer:
    """By the gains of the guide, which may move the states less than the current model's, then a rough refit."""
    model, own = question.model, current.rig.model
    p = model.vector(question.rig.parameters)
    p[[model.index(parameter.name) for parameter in own.parameters]] = current.answer.p
    for name, value in effect.qualified(values).items():
        low, high = model.parameters[model.index(name)].bounds
        p[model.index(name)] = min(max(value, low), high)
    levels = current.answer.noise.levels
    best = likeliest(question, [(p, levels), (_faint(p, effect, model), levels)])
    with contextlib.suppress(SolveError):  # it holds on to the data by more noise than the guide allows
        led = steered_fit(question, p, guide.question.model, guide.filtered, QUICK)
        best = likeliest(question, [best, *((led, levels - by) for by in SCANNED)])
    return maximise(question, *best, iterations=QUICK, polish=False, near=guide)


def _faint(p: np.ndarray, effect: Effect, model: Model) -> np.ndarray:
    """The same with a trace of the effect only: as likely as without it, wherever the screen would have led."""
    p = p.copy()
    for name, null in effect.at_null().items():
        if name in effect.strength:
            i = model.index(f"{effect.name}.{name}")
            p[i] = null + FAINT * (p[i] - null)
    return p


def _misfit(effect: Effect, candidate: Candidate, gain: float, screened: int) -> str:
    """Why a refitted effect does not even fit the recordings it was given; empty when it does."""
    size, count = _size(effect, candidate.rig, candidate.answer), len(effect.parameters)
    needed = stats.chi2.isf(LEVEL / max(screened, 1), count) + _cost(effect)
    if gain < needed:
        return f"the refit gains {gain:.0f} in -2 log likelihood where {needed:.0f} are needed"
    if size < 1.0:
        return f"the refit leaves it at {100 * size:.0f} % of the smallest size worth a name"
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


def _formal(current: Candidate, more: float) -> str:
    """Whether an effect beside others clears no more than the form of their laws may have left; empty if it does."""
    if current.effects and more < FORM:
        return f"it clears {100 * max(more, 0):.1f} % of the first error: the form of the laws before it may leave that"
    return ""


def own_values(effect: Effect, rig: Rig, answer: Answer) -> dict[str, float]:
    """The fitted values of an effect's parameters by own name, SI."""
    index = rig.model.index
    return {q.name: float(answer.p[index(f"{effect.name}.{q.name}")]) for q in effect.parameters}


def _size(effect: Effect, rig: Rig, answer: Answer) -> float:
    return effect.size(own_values(effect, rig, answer))


def _thinned(
    base: Candidate, current: Candidate, before: Candidate, data: Data, plain: Model, report: Report
) -> tuple[Candidate, dict[str, Candidate], tuple[Effect, ...]]:
    """Without the effects that a later one made idle; what each of the others is needed for; those dropped.

    `before` is the model before the last effect, which has just been confirmed in the others' presence.
    """
    dropped: list[Effect] = []
    while True:
        without: dict[str, Candidate] = {}
        weakest: tuple[float, Effect, Candidate] | None = None
        for effect in current.effects:
            if before.effects == current.effects[:-1] and effect is current.effects[-1]:
                without[effect.name] = before
                continue
            report(0.92, f"whether {effect.name} is still needed")
            others = tuple(e for e in current.effects if e is not effect)
            one = refitted(base.rig, others, current, data, plain) if others else base
            without[effect.name] = one
            loss = compare(one.judged, current.judged, data.generator)
            needed = stats.chi2.isf(LEVEL, len(effect.parameters)) + _cost(effect)
            idle = loss.p_value > LEVEL or one.answer.score - current.answer.score < needed
            if idle and (weakest is None or loss.gain < weakest[0]):
                weakest = (loss.gain, effect, one)
        if weakest is None:
            return current, without, tuple(dropped)
        dropped.append(weakest[1])
        rough = weakest[2]
        current = (
            base
            if rough is base
            else settled(rough.effects, rough.rig, rough.answer.p, rough.answer, data, plain)
        )
