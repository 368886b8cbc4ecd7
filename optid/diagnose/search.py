"""Which effects are missing: added one at a time with a refit of everything, dropped again where idle.

A screen picks the few worth a refit; the refits compete by likelihood; recordings kept out of the refits decide. Where
two effects are missing either may need the other before it predicts better: one step may go ahead unconfirmed, and
counts only if the next one is confirmed and both turn out to be needed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

from scipy import stats

from optid.core.model import Model
from optid.diagnose.candidate import QUIETER, Candidate, Data, Report, refitted, settled
from optid.diagnose.judge import EXCESS, cleared, compare, excess
from optid.diagnose.refit import FORM, LEVEL, TINY, Contest, Rival, cost, refit
from optid.diagnose.screen import Signature, screen
from optid.effects.effect import Effect
from optid.effects.library import admitted
from optid.fit.scoring import quieted

REFITS = 5  # candidates of a round
SECOND = 3  # candidates of a round that only the look at the fitted process noise brings in
DEEPEST = 3  # effects at most


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
        if _nothing_left(base, current, data):
            rounds.append(Round(current, tuple(signatures), (), None, None))
            break
        tight, guide = [], current.answer
        if excess(current.judged, data.noise) > EXCESS:
            # What is missing may hide in the process noise: look with less of it, too.
            guide = quieted(current.answer, QUIETER)
            tight = screen(guide, data.train, effects)
        few = _promising(signatures, tight)
        contest = Contest(base, current, guide, len(signatures), data, partial(report, share))
        rivals = refit(contest, few)
        winner = next((rival for rival in rivals if not rival.why), None)
        ahead = winner
        if winner is None and current is confirmed and depth + 1 < DEEPEST and tight:
            hopeful = [rival for rival in rivals if rival.hopeful]
            ahead = max(hopeful, key=lambda rival: rival.train_gain, default=None)
        rounds.append(Round(current, tuple(signatures), tuple(rivals), winner, ahead))
        if ahead is None:
            break
        before, current = current, ahead.candidate
        if winner is not None:
            confirmed = current
    best, without, dropped = _thinned(base, confirmed, before, data, plain, report)
    return Search(base, best, tuple(rounds), without, dropped)


def _nothing_left(base: Candidate, current: Candidate, data: Data) -> bool:
    """No further effect may be named: there are as many as can be, or they leave less than another must clear."""
    if len(current.effects) == DEEPEST:
        return True
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
            needed = stats.chi2.isf(LEVEL, len(effect.parameters)) + cost(effect)
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
