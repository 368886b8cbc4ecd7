"""Rivals of a round: an effect refitted, what it gains, and why it is taken or not."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from optid.diagnosis.candidate import Candidate, Data, centred
from optid.diagnosis.judge import EXCESS, Comparison, brought_to_noise, cleared, compare, excess, judge
from optid.diagnosis.screen import Signature
from optid.effects.effect import Effect
from optid.estimation.place import Answer
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
SAME = 0.25  # share by which own values differ at most where a refit stands where its effect leads from afar


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
    """An effect on its way through a round: `values` is where the screen would have it, SI, by own name.

    `foreseen` is what its windows gain, where that counts as well as likelihood, in its units: for what describes.
    """

    effect: Effect
    rig: Rig
    answer: Answer
    values: Mapping[str, float]
    foreseen: float = -math.inf

    @property
    def size(self) -> float:
        """In smallest sizes worth a name."""
        return self.effect.size(own_values(self.effect, self.rig, self.answer))


def foremost(rivals: list[Rival]) -> list[Rival]:
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


def rival_of(c: Contest, t: Refitted, place: int) -> Rival:
    """A refitted effect against the model of its round, in its turn by likelihood."""
    effects = (*c.current.effects, t.effect)
    t.rig, t.answer = centred(effects, t.rig, t.answer)
    candidate = Candidate(effects, t.rig, t.answer, judge(t.answer, c.data.holdout))
    return _rival(c, t, candidate, level(place))


def as_last(c: Contest, effect: Effect, candidate: Candidate) -> Rival:
    """An effect of a model as the last to come to the model of the round, which has all others; alone in its turn."""
    return _rival(c, Refitted(effect, candidate.rig, candidate.answer, {}), candidate, LEVEL)


def _rival(c: Contest, t: Refitted, candidate: Candidate, at: float) -> Rival:
    gain = max(c.current.answer.score - t.answer.score, t.foreseen)
    against = compare(c.current.judged, candidate.judged, c.data.generator)
    why = misfit(t, gain, c.screened)
    rival = Rival(t.effect, candidate, gain, against, why, hopeful=not why)
    return replace(rival, why=reason(c, rival, at))


def level(place: int) -> float:
    """Each refit takes its turn by likelihood, and has half of the hold-out's error rate that is left."""
    return LEVEL / 2.0 ** (place + 1)


def reason(c: Contest, rival: Rival, at: float) -> str:
    """Why a rival is not taken at a level of significance; empty if it may be."""
    if not rival.hopeful:
        return rival.why
    why = _unproven(rival.against, at)
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
    """The best first, of two as good the one with fewer parameters; those with a reason against them last.

    Less than a unit of likelihood says nothing.
    """
    price = cost(rival.effect) - rival.train_gain - rival.against.bounded_gain
    return bool(rival.why), float(np.round(price))


def alike(one: Effect, other: Effect) -> bool:
    """Either is known to be easily confused with the other."""
    return one.name in other.look_alikes or other.name in one.look_alikes


def cost(effect: Effect) -> float:
    """What parameters gain by themselves in -2 log likelihood, as Schwarz's criterion has it."""
    return len(effect.fitted) * math.log(1e4)


def misfit(t: Refitted, gain: float, screened: int) -> str:
    """Why a refitted effect does not even fit the recordings it was given; empty when it does."""
    needed = stats.chi2.isf(LEVEL / max(screened, 1), len(t.effect.fitted)) + cost(t.effect)
    if gain < needed:
        return f"the refit gains {gain:.0f} in -2 log likelihood where {needed:.0f} are needed"
    if t.size < 1.0:
        return f"the refit leaves it at {100 * t.size:.0f} % of the smallest size worth a name"
    return ""


def _unproven(against: Comparison, at: float) -> str:
    """What the recordings held out have against a refitted effect; empty when they confirm it."""
    if against.p_value > at:
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
