"""Parameters whose predictions over windows miss the recordings least: a fit by multi-step prediction errors.

Maximum likelihood with process noise looks ahead by one sample. Where a law's form is not nature's it takes the rest
for noise, may settle on a top beside the right one, and predicts worse over half a second than the same law could.
Errors over windows see what adds up in them; consistent where the law is right (Ljung, System Identification, 1999,
section 4.4), they make the best of one that is not.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from optid.core.model import Array
from optid.errors import SolveError
from optid.estimation.likelihood import Filtered, huber
from optid.estimation.place import Answer, Place
from optid.estimation.problem import Booleans, Problem
from optid.estimation.scoring import likeliest
from optid.estimation.steering import innovations, steered_fit

TURNS, TURN = 4, 4  # times that the windows' starts are taken anew by a filter, and steps of each
WORTH = 5e-3  # of the loss: a turn that gains less is the last
ASTRAY = 0.5  # of what windows miss: where likelihood leads to twice as much, process noise is likelier, not the law
QUIETER = (0.0, 1.25, 2.5)  # log: by how much less process noise may suit what a turn found


def foreseeing(answer: Answer, seconds: float) -> Answer:
    """The same question answered by windows of so many seconds, begun where the filter stands before each of them.

    Process noise falls where less of it is likelier. The answer itself if nothing does better; its score is the
    likelihood's in any case.
    """
    q, looks = answer.question, windows(answer.question.problem, seconds)
    here = Place(q, answer.p, answer.noise)
    least = _loss(here, looks)
    first = here
    for _ in range(TURNS):
        if q.over:
            break
        with contextlib.suppress(SolveError):
            p = steered_fit(q, here.p, q.model, _measuring(here), TURN, looks=looks).p
            levels = likeliest(q, [(p, here.noise.levels - by) for by in QUIETER])[1]
            there = Place(q, p, replace(answer.noise, levels=levels))
            loss = _loss(there, looks)
            if loss < least:
                small = least - loss < WORTH * least
                here, least = there, loss
                if not small:
                    continue
        break
    if here is first:
        return answer
    here.differentiate()
    return here.answer(False)


def preferable(likely: Answer, led: Answer, seconds: float, astray: float = ASTRAY) -> Answer:
    """Of two answers of one question the likelier, unless windows of `led` miss less by the share `astray` or more."""
    if likely.score <= led.score and misses(led, seconds) >= (1.0 - astray) * misses(likely, seconds):
        return likely
    return led


def misses(answer: Answer, seconds: float) -> float:
    """What such windows miss, by Huber's loss in variances of the measurement."""
    return _loss(Place(answer.question, answer.p, answer.noise), windows(answer.question.problem, seconds))


def misses_unseen(led: Answer, seconds: float) -> tuple[float, list[Array]]:
    """What windows of each recording miss by parameters that windows of the others lead to (cross-validation).

    Where a law's form is not nature's every motion asks for parameters of its own, and what is best for all recordings
    together need not be for the next. With one recording there is nothing to leave out: what its windows miss.

    Returns:
        The loss, and the parameters without each recording, (parameters,) each; none with one recording.
    """
    q = led.question
    owners = np.unique(q.problem.recording)
    if len(owners) < 2:
        return misses(led, seconds), []
    looks, gains = windows(q.problem, seconds), _measuring(Place(q, led.p, led.noise))
    lost, without = 0.0, []
    for left_out in owners:
        own = q.problem.recording == left_out
        rest = np.flatnonzero(~own).tolist()
        p = steered_fit(q, led.p, q.model, gains, TURN, rest, looks).p
        lost += _loss(Place(q, p, led.noise), looks, np.flatnonzero(own).tolist())
        without.append(p)
    return lost, without


def windows(problem: Problem, seconds: float) -> Booleans:
    """Samples at which windows begin, (samples,); up to the first one's end every sample, as nothing is known yet."""
    looks = np.zeros(len(problem.time), dtype=np.bool_)
    for begin, count in zip(problem.begins, problem.counts, strict=True):
        rows = slice(begin, begin + count + 1)
        number = np.floor((problem.time[rows] - problem.time[begin]) / seconds + 1e-9).astype(int)
        looks[rows] = (number == 0) | np.r_[True, np.diff(number) > 0]
    return looks


def _measuring(here: Place) -> Filtered:
    """The filter's gains, and the measurement's own variances."""
    f = here.filtered
    return replace(f, variances=np.broadcast_to(here.noise.measurement, f.variances.shape))


def _loss(here: Place, looks: Booleans, only: Sequence[int] | None = None) -> float:
    """Of all segments, or of these only."""
    q = here.q
    z: Array = innovations(q, here.p[None], q.model, _measuring(here), only, looks)
    prior = ((here.p[list(q.free)] - q.prior) / q.prior_sd) ** 2
    return 0.5 * float(huber(z).sum() + prior.sum())
