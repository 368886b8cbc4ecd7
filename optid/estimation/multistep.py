"""Multi-step prediction errors: models are fitted to what they predict over windows in which nothing is corrected.

From sample to sample even a wrong model hardly errs, and process noise takes the rest; over a window a wrong law adds
up. Each window begins where a quiet filter of the model itself stands, whose gains are held while parameters move
(Ljung, System Identification, 1999, sections 4.4 and 8.4) and taken anew at every turn.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from optid.core.model import Array
from optid.errors import SolveError
from optid.estimation.fisher_scoring import default_process_noise
from optid.estimation.fixed_gain import fixed_gain_fit, innovations
from optid.estimation.likelihood import Filtered, Noise, deviance, huber, run_filter
from optid.estimation.likelihood_point import LEVELS, LikelihoodProblem
from optid.estimation.problem import Booleans, Problem

# Log of the share of a middling process noise that a quiet filter has: so little that what is missing is not taken for
# it, and enough to hold the states of a wrong model to the data. A model that lacks little is better off with less.
QUIET, STEP = -2.0, -1.0
SETTLED = 5e-3  # of the loss: a turn that gains less is the last
# Of the loss: beyond the turns asked for a fit goes on while each takes so much, MOST at most. Under stick-slip a fit
# may cross a plain for some turns before it falls to its optimum.
FALLING, MOST = 0.1, 12


@dataclass(frozen=True, eq=False)
class MultistepFit:
    """Where a fit by multi-step prediction errors ended.

    Attributes:
        likelihood_problem: model, recordings and free parameters.
        p: the whole parameter vector.
        filtered: the quiet filter there, whose variances are those that windows' errors should have.
        loss: Huber's, of the windows' errors in sd.
        level: of the filter's process noise, as a log of its share of a middling one.
    """

    likelihood_problem: LikelihoodProblem
    p: Array
    filtered: Filtered
    loss: float
    level: float


def quiet_noise(q: LikelihoodProblem, level: float = QUIET) -> Noise:
    """Measurement noise, and process noise that takes over nothing."""
    return Noise(q.measurement, q.groups, np.maximum(default_process_noise(q) + level, LEVELS[0]))


def quiet_filter(
    q: LikelihoodProblem, p: Array, only: Sequence[int] | None = None, level: float = QUIET
) -> Filtered | None:
    """A filter with quiet noise over all segments or `only` some; ``None`` where the simulation diverges."""
    noise = quiet_noise(q, level)
    Q = noise.spectrum(len(q.model.states))[None]
    f = run_filter(q.model, q.problem, p[None], Q, noise.measurement[None], keep=True, only=only)
    if not math.isfinite(float(deviance(f.innovations, f.variances).sum())):
        return None
    variance = noise.measurement + (0.0 if q.open_variance is None else q.open_variance)
    return replace(f, variances=np.broadcast_to(variance, f.variances.shape))


def window_starts(problem: Problem, seconds: float) -> Booleans:
    """Samples at which windows begin, (samples,); up to the first one's end every sample, as nothing is known yet."""
    starts = np.zeros(len(problem.time), dtype=np.bool_)
    for begin, count in zip(problem.begins, problem.counts, strict=True):
        rows = slice(begin, begin + count + 1)
        number = np.floor((problem.time[rows] - problem.time[begin]) / seconds + 1e-9).astype(int)
        starts[rows] = (number == 0) | np.r_[True, np.diff(number) > 0]
    return starts


def fit_multistep(
    q: LikelihoodProblem,
    p: Array,
    seconds: float,
    *,
    turns: int,
    steps: int,
    only: Sequence[int] | None = None,
    level: float = QUIET,
    most: int = MOST,
) -> MultistepFit:
    """Parameters by windows of so many seconds, with gains taken anew at every turn, from a start.

    Args:
        q: the likelihood problem.
        p: start, (parameters,).
        seconds: length of a window.
        turns: times that gains are taken anew; more while the loss falls fast.
        steps: of Gauss-Newton under the gains of a turn, at most.
        only: these segments count, all if absent.
        level: of the filter's process noise at the start, or the usual one if that predicts better; it falls as long
            as that predicts better.
        most: turns in all, however fast the loss falls.

    Raises:
        SolveError: the model cannot be simulated at the start.
    """
    starts = window_starts(q.problem, seconds)
    best = _best_of(_stands(q, p, only, starts, by) for by in {level, QUIET})
    if best is None:
        raise SolveError("the simulation diverged at the start values; check them and their units")
    for turn in range(1, most + 1):
        if q.budget.is_over:
            break
        there = None
        with contextlib.suppress(SolveError):
            moved = fixed_gain_fit(q, best.p, q.model, best.filtered, steps, only, starts).p
            there = _best_of(_stands(q, moved, only, starts, best.level + by) for by in (0.0, STEP))
        if there is None or not there.loss < best.loss:
            break
        gain = 1.0 - there.loss / best.loss
        best = there
        if gain < (SETTLED if turn < turns else FALLING):
            break
    return best


def _best_of(fits: Iterable[MultistepFit | None]) -> MultistepFit | None:
    return min((one for one in fits if one is not None), key=lambda one: one.loss, default=None)


def _stands(
    q: LikelihoodProblem, p: Array, only: Sequence[int] | None, starts: Booleans, level: float = QUIET
) -> MultistepFit | None:
    """What windows miss at some parameters under the gains of their own filter."""
    f = quiet_filter(q, p, only, level)
    if f is None:
        return None
    (z,) = innovations(q, p[None], q.model, f, only, starts)
    return MultistepFit(q, p, f, 0.5 * float(huber(z).sum()), level)


def multistep_at(q: LikelihoodProblem, p: Array, seconds: float, level: float = QUIET) -> MultistepFit:
    """Parameters as they are, with the filter and the loss there.

    Raises:
        SolveError: the model cannot be simulated.
    """
    there = _stands(q, p, None, window_starts(q.problem, seconds), level)
    if there is None:
        raise SolveError("the simulation diverged")
    return there


def multistep_loss(q: LikelihoodProblem, p: Array, seconds: float, level: float = QUIET) -> float:
    """Huber's loss of windows' errors, in sd; infinite where the simulation diverges."""
    there = _stands(q, p, None, window_starts(q.problem, seconds), level)
    return math.inf if there is None else there.loss
