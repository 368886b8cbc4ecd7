"""Which effects explain the recordings as well as the one that was named."""

from __future__ import annotations

from optid.diagnose.candidate import Candidate, Data
from optid.diagnose.judge import compare
from optid.diagnose.refit import Rival
from optid.diagnose.search import Search
from optid.effects.effect import Effect

AS_GOOD = 0.9  # share of the winner's gain in likelihood that a rival must reach
LEVEL = 0.05  # at which the hold-out must prefer the winner to tell them apart


def indistinguishable(found: Search, effect: Effect, data: Data) -> tuple[str, ...]:
    """Names of the rivals of an effect's round that recordings and hold-out cannot tell from it."""
    for one in found.rounds:
        mine = one.ahead
        if mine is None or mine.effect.name != effect.name:
            continue
        return tuple(
            rival.effect.name
            for rival in one.rivals
            if rival is not mine and _as_good(rival, mine, data) and not _kept(rival, found.best)
        )
    return ()


def _as_good(rival: Rival, mine: Rival, data: Data) -> bool:
    if rival.train_gain < AS_GOOD * mine.train_gain:
        return False
    against = compare(rival.candidate.judged, mine.candidate.judged, data.generator)
    return against.p_value > LEVEL


def _kept(rival: Rival, best: Candidate) -> bool:
    return rival.effect.name in {effect.name for effect in best.effects}
