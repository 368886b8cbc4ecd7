"""Which effects are missing: added one at a time with a refit of everything, dropped again where idle.

A screen picks the few worth a refit; the refits compete by likelihood; recordings kept out of the refits decide. Where
two effects are missing either may need the other before it predicts better: one step may go ahead unconfirmed, and
counts only if the next one is confirmed and both turn out to be needed. In the end the first one, which was chosen
alone, has to hold its place beside the others.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from scipy import stats

from optid.core.model import Model
from optid.diagnosis.afar import from_afar
from optid.diagnosis.candidate import ABOUT, QUIETER, Candidate, Data, Report, refitted, settled
from optid.diagnosis.contest import FORM, LEVEL, MOST, Contest, Rival, arrived, as_last, cost
from optid.diagnosis.judge import EXCESS, beyond_noise, cleared, excess
from optid.diagnosis.lead import stood
from optid.diagnosis.refit import TINY, refit
from optid.diagnosis.screen import Signature, screen
from optid.diagnosis.settling import likelier, rigidly
from optid.effects.effect import Effect
from optid.effects.library import admitted
from optid.estimation.place import Answer
from optid.estimation.scoring import quieted

REFITS = 5  # candidates of a round
LITTLE = 2  # candidates of a round when little is left to explain
SECOND = 3  # candidates of a round that only another look brings in, or that come before one
DEEPEST = 3  # effects at most
# Of the squared error, what names must clear where no trial has measured what right ones leave: an even share among as
# many as can be named and a rest.
EVEN = 1 / (DEEPEST + 1)


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
class _Look:
    """What a round looked at.

    Attributes:
        screened: what the screen saw, the most promising first.
        led: where effects lead, likewise; nothing where little is left.
        guide: by whose gains; the model with less process noise than suits it, if much is missing.
        rivals: who was refitted, the best first.
    """

    screened: tuple[Signature, ...]
    led: tuple[Signature, ...]
    guide: Answer
    rivals: tuple[Rival, ...]


@dataclass(frozen=True, eq=False)
class Instead:
    """A model with a look-alike in the place of an effect.

    Attributes:
        effect: the look-alike.
        candidate: the model.
        level: whether prediction errors under the same held gains tell the two apart as little as they tell anything.
    """

    effect: Effect
    candidate: Candidate
    level: bool


@dataclass(frozen=True, eq=False)
class Search:
    """How the search went.

    Attributes:
        base, best: the model before, and the one it ended with.
        rounds: every step.
        without: the best model without one of its effects, by that effect's name.
        dropped: effects that others made idle, each against the model without it.
        instead: models with a look-alike in the place of an effect, by that effect's name.
        stopped: its time was over before everything was tried.
        rigid: contacts of the best model may be as short as their law allows, and so those of its rivals.
    """

    base: Candidate
    best: Candidate
    rounds: tuple[Round, ...]
    without: Mapping[str, Candidate] = field(default_factory=dict)
    dropped: tuple[Rival, ...] = field(default=())
    instead: Mapping[str, tuple[Instead, ...]] = field(default_factory=dict)
    stopped: bool = False
    rigid: bool = False


def search(
    base: Candidate,
    own: Sequence[Effect],
    data: Data,
    report: Report,
    aside: Callable[[], None] = lambda: None,
) -> Search:
    """Add effects while held-out recordings confirm them.

    Args:
        base: the model to which they come.
        own: the user's own, beside the catalogue.
        data: recordings, and until when to search.
        report: is told what is being done.
        aside: called once before a second effect is looked for, where the first does not stand.
    """
    plain, current, before, rounds = base.rig.model, base, base, []
    confirmed, guide = base, None
    for depth in range(DEEPEST + 1):
        tell = partial(report, 0.1 + 0.8 * depth / (DEEPEST + 1))
        tell(f"round {depth + 1}: screening the catalogue")
        little, much = _little_left(base, current, data), excess(current.judged, data.noise) > EXCESS
        # What the pasts of windows leave open may be all they err by; it may as well hide something.
        quiet = little and not much and not beyond_noise(current.judged, data.noise)
        ended = len(current.effects) == DEEPEST or quiet or _hopeless(base, current, data) or data.over
        if depth == 1 and much and not ended and not stands(base, current, data):
            aside()
        most = 0 if ended else LITTLE if little else None
        look = _round(base, current, own, data, tell, most, guide=guide)
        if data.over:
            look = replace(look, rivals=tuple(in_time(rival, data) for rival in look.rivals))
        winner = next((rival for rival in look.rivals if not rival.why), None)
        ahead = winner
        if (
            not data.over
            and winner is None
            and current is confirmed
            and depth + 1 < DEEPEST
            and much
            and not little
        ):
            ahead = _unconfirmed(look, beside=bool(confirmed.effects))
        guide = None if ahead is None else _guiding(look, ahead, current, data, plain)
        rounds.append(Round(current, look.screened, look.rivals, winner, ahead))
        if ahead is None:
            break
        before, current = current, ahead.candidate
        if winner is not None:
            if _little_left(base, current, data):
                # It may be all there is, and stand beside its top: nothing else is to be tried then.
                tell("where its windows lead")
                current = likelier(current, data)
            if excess(current.judged, data.noise) > EXCESS:
                tell("the same from a plain start")
                current, data = rigidly(current, data)
            confirmed = current
    stopped = data.over  # what was left out of the rounds, no one counts
    closing = replace(data, until=math.inf)  # to know what was found takes its time
    best, without, dropped = _thinned(base, confirmed, before, closing, plain, report)
    if len(best.effects) > 1 and not stopped and excess(best.judged, data.noise) > EXCESS:
        other = _exchanged(base, best, without, own, data, partial(report, 0.92))
        if other is not None and other.winner is not None:
            rounds.append(other)
            best, without, more = _thinned(base, other.winner.candidate, other.model, closing, plain, report)
            dropped += more
    return Search(base, best, tuple(rounds), without, dropped, stopped=stopped, rigid=data.rigid)


def _round(
    base: Candidate,
    current: Candidate,
    own: Sequence[Effect],
    data: Data,
    tell: Callable[[str], None],
    most: int | None = None,
    but: str = "",
    guide: Answer | None = None,
    afar: bool = True,
) -> _Look:
    """A look at the catalogue from a model, and refits of the `most` promising `but` one.

    Where much is missing, and the model may be bent, effects are first led from `afar`; where less is, only if the
    screen shows none that explains it. `guide` leads in place of the model itself, where that has too much process
    noise to show the way.
    """
    effects = [effect for effect in admitted(current.rig.model, own) if effect.name != but]
    signatures = screen(current.answer, data.train, effects)
    if most == 0:
        return _Look(tuple(signatures), (), current.answer, ())
    much = excess(current.judged, data.noise)
    if much > EXCESS:
        guide = guide or quieted(current.answer, QUIETER)
    # Few samples of a slow plant never tell a bent model from a right one.
    guide, bent = guide or current.answer, much > ABOUT or data.misfit is not None
    contest = Contest(base, current, guide, len(signatures), data, tell)
    led: list[Signature] = []
    rivals: list[Rival] = []

    def lead() -> None:
        tell("where effects lead from afar")
        led.extend(from_afar(current, guide, effects, data, base.rig.model)[: most or REFITS])
        farther = [one for one in led if not any(arrived(rival, one) for rival in rivals)]
        rivals[:] = refit(contest, farther, rivals) if farther else rivals

    if afar and bent:
        lead()
    if not _explained(rivals, data):
        # What is missing may hide in the process noise: look with less of it, too.
        tight = [] if guide is current.answer else screen(guide, data.train, effects)
        near = _promising(signatures, tight)[: most or (SECOND if led else None)]
        # One that came from afar and is not confirmed may have lost its way: it begins here, too.
        near = [
            one for one in near if not any(not rival.why and rival.effect is one.effect for rival in rivals)
        ]
        rivals[:] = refit(contest, near, rivals) if near else rivals
    if (
        afar
        and not bent
        and much > EXCESS
        and most is None
        and not _explained(rivals, data)
        and not data.over
    ):
        lead()
    return _Look(tuple(signatures), tuple(led), guide, tuple(rivals))


def _explained(rivals: Sequence[Rival], data: Data) -> bool:
    """One is confirmed that leaves nothing."""
    return any(not one.why and excess(one.candidate.judged, data.noise) <= EXCESS for one in rivals)


def in_time(rival: Rival, data: Data) -> Rival:
    """One whose rivals may not have had their turn does not win, unless it leaves them nothing to explain."""
    whole = excess(rival.candidate.judged, data.noise) <= EXCESS
    return rival if rival.why or whole else replace(rival, why="the time was over before all had their turn")


def _unconfirmed(look: _Look, beside: bool = False) -> Rival | None:
    """With whom to go on though nobody is confirmed: who led best, or else who fits best what it was given.

    Where more is missing, likelihood may give an effect up for process noise; `beside` a confirmed one, which stands
    for most of that, it may not.
    """
    led = () if beside else look.led[:1]
    first = [rival for one in led for rival in look.rivals if rival.effect is one.effect]
    hopeful = [rival for rival in look.rivals if rival.hopeful]
    return first[0] if first else max(hopeful, key=lambda rival: rival.train_gain, default=None)


def _guiding(look: _Look, ahead: Rival, current: Candidate, data: Data, plain: Model) -> Answer | None:
    """The model that leads from `ahead` where much is missing still: as it led there, not as likelihood bent it."""
    if excess(ahead.candidate.judged, data.noise) <= ABOUT:
        return None
    led = next((led for led in look.led if led.effect is ahead.effect), None)
    return None if led is None else stood(current, led, look.guide, data, plain)


def _exchanged(
    base: Candidate,
    best: Candidate,
    without: Mapping[str, Candidate],
    own: Sequence[Effect],
    data: Data,
    tell: Callable[[str], None],
) -> Round | None:
    """A round from the others alone, won by what does better in the first effect's place; ``None`` if nothing does.

    The first was chosen where the others were not there yet.
    """
    first = best.effects[0]
    tell(f"whether something else does better than {first.name}")
    start = without[first.name]
    look = _round(base, start, own, data, tell, but=first.name, afar=False)
    winner = next((rival for rival in look.rivals if not rival.why), None)
    if winner is None:
        return None
    gain = best.answer.score + cost(first) - winner.candidate.answer.score - cost(winner.effect)
    return Round(start, look.screened, look.rivals, winner, winner) if gain > 0.0 else None


def explains_little(base: Candidate, current: Candidate, data: Data) -> bool:
    """The effects clear less than they leave: what is missing is more likely none of the catalogue's."""
    return cleared(base.judged, current.judged, data.noise) < MOST


def stands(base: Candidate, best: Candidate, data: Data) -> bool:
    """Whether names clear as much of the squared error as right ones do."""
    return bool(best.effects) and cleared(base.judged, best.judged, data.noise) >= needed(base)


def needed(base: Candidate) -> float:
    """Share of the squared error that names must clear to stand."""
    leave = base.rig.model.laws_leave
    return EVEN if leave is None else 1.0 - leave


def _hopeless(base: Candidate, current: Candidate, data: Data) -> bool:
    """The last effect would have to clear more than those before it together, and they were taken as the largest."""
    if len(current.effects) < DEEPEST - 1:
        return False
    return cleared(base.judged, current.judged, data.noise) < needed(base) / 2


def _little_left(base: Candidate, current: Candidate, data: Data) -> bool:
    """What the form of a law may leave: only an effect that takes most of it, or all but the noise, is still named."""
    return bool(current.effects) and 1.0 - cleared(base.judged, current.judged, data.noise) < FORM


def _promising(plain: Sequence[Signature], tight: Sequence[Signature]) -> list[Signature]:
    """What is worth a refit, of each look the best, an effect once."""
    few: dict[str, Signature] = {}
    for look, most in ((tight, REFITS), (plain, REFITS if not tight else SECOND)):
        gate = stats.chi2.isf(LEVEL / max(len(look), 1), 1)
        good = [s for s in look if s.gain > gate and s.effect.size(s.values) > TINY]
        for signature in good[:most]:
            few.setdefault(signature.effect.name, signature)
    return list(few.values())


def _thinned(
    base: Candidate, current: Candidate, before: Candidate, data: Data, plain: Model, report: Report
) -> tuple[Candidate, dict[str, Candidate], tuple[Rival, ...]]:
    """Without the effects that others make idle; what each of those left is needed for; those dropped.

    An effect stays if it would be confirmed as the last to come: what brought it may have been the want of another.
    `before` is the model before the last effect.
    """
    dropped: list[Rival] = []
    while True:
        without: dict[str, Candidate] = {}
        idle: list[Rival] = []
        for effect in current.effects:
            report(0.92, f"whether {effect.name} is still needed")
            others = tuple(e for e in current.effects if e is not effect)
            one = refitted(base.rig, others, current, data, plain) if others else base
            if before.effects == others:  # it may have stood on a lower top than where the last effect led
                one = min(before, one, key=lambda found: found.answer.score)
            without[effect.name] = one
            last = as_last(Contest(base, one, one.answer, 1, data, partial(report, 0.92)), effect, current)
            if last.why:
                idle.append(last)
        if not idle:
            return current, without, tuple(dropped)
        dropped.append(min(idle, key=lambda last: last.against.gain))
        rough = without[dropped[-1].effect.name]
        current = (
            base
            if rough is base
            else settled(rough.effects, rough.rig, rough.answer.p, rough.answer, data, plain)
        )
