"""Forms that follow the gains of their own filters from where they led: a fit that likelihood is not asked for.

Prediction errors under held gains, the gains taken anew at every turn (Ljung, System Identification, 1999, section
8.4), lead past the tops that process noise makes, and cost a fraction of a refit by likelihood.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence

import numpy as np

from optid.core.model import Array
from optid.diagnosis.afar import calm
from optid.diagnosis.candidate import Data
from optid.diagnosis.contest import Contest, Refitted, Rival, order, rival_of
from optid.diagnosis.judge import EXCESS, excess
from optid.diagnosis.refit import placed, posed
from optid.diagnosis.screen import Signature
from optid.errors import SolveError
from optid.estimation.likelihood import Noise
from optid.estimation.multistep import foreseeing, misses, preferable
from optid.estimation.place import Answer, Place, Question
from optid.estimation.scoring import NEARBY, likeliest, middling
from optid.estimation.steering import STEPS, steered_fit

# Turns by the gains of its own filter, how many may lead to worse places in a row, and by how much
# less process noise may suit what they find.
TURNS, ASTRAY = 6, 2
WORSE = (
    0.1  # of what windows miss: a form is for simulation, and turns that are likelier must not cost it more
)
CALM = (0.0, 1.25, 2.5, 3.75, 5.0, 6.25)


def led_on(c: Contest, few: Sequence[Signature], before: Sequence[Rival] = ()) -> list[Rival]:
    """Forms where they led and further, by the gains of their own filters, best first; nothing is left to likelihood.

    A form that arrives at the noise leaves the others nothing. Rivals `before` are counted with them.
    """
    rivals = list(before)
    for signature in few:
        if c.data.over:
            break
        c.tell(f"following {signature.effect.name}")
        with contextlib.suppress(SolveError):  # it may lead out of the numbers
            rivals.append(rival_of(c, _turning(c, signature), len(rivals)))
            if at_noise(rivals[-1], c.data):
                break
    return sorted(rivals, key=order)


def at_noise(rival: Rival, data: Data) -> bool:
    """It is confirmed, and leaves nothing to explain."""
    return not rival.why and excess(rival.candidate.judged, data.noise) <= EXCESS


def _turning(c: Contest, signature: Signature) -> Refitted:
    """An effect from where it led, by whole windows and along the gains of its own filter, as quiet as is likeliest.

    Not every turn is likelier than the one before: where a model is far off, the way leads through worse places.

    Raises:
        SolveError: the model cannot be simulated where it led.
    """
    effect, here, question = signature.effect, c.current.answer, posed(c, signature)
    p = placed(c, question, {**signature.beside, **effect.qualified(signature.values)}, here)
    levels = [at - by for at in (here.noise.levels, middling(question)) for by in CALM]

    def stand(p: Array) -> Place:
        p, level = likeliest(question, [(p, at) for at in levels])
        return Place(question, p, Noise(question.measurement, question.groups, level))

    first = best = there = stand(_foreseen(question, p, c.current.judged.horizon))
    if not math.isfinite(best.score):
        raise SolveError("the model leaves the numbers where it led")
    worse = 0
    with contextlib.suppress(SolveError):  # the best before has to do
        for _ in range(TURNS - 1):
            if c.data.over or worse == ASTRAY:
                break
            there = stand(steered_fit(question, there.p, question.model, there.filtered, STEPS).p)
            won = best.score - there.score
            if won > 0.0:
                best, worse = there, 0
            else:
                worse += 1
            if 0.0 <= won < NEARBY * abs(here.score - best.score):
                break
    first.glance()
    if best is not first:
        best.glance()
    answer = preferable(best.answer(False), first.answer(False), c.current.judged.horizon, WORSE)
    return Refitted(effect, question.rig, answer, signature.values, _gained(c, answer))


def _gained(c: Contest, answer: Answer) -> float:
    """What whole windows of the recordings to fit gain; each counts once, as what they miss lasts all through them.

    A form that is not nature's may predict far better and be less likely for it: where it jumps a moment too late, the
    filter is surprised, and process noise is not.
    """
    seconds = c.current.judged.horizon
    length = max(seconds / float(np.median(answer.question.problem.dt)), 1.0)
    return 2.0 * (misses(c.current.answer, seconds) - misses(answer, seconds)) / length


def _foreseen(question: Question, p: Array, seconds: float) -> Array:
    """Where whole windows lead from there; there itself if that is no model in so little process noise."""
    here = Place(question, p, calm(question))
    if not math.isfinite(here.score):
        return p
    here.glance()
    return foreseeing(here.answer(False), seconds).p
