"""Multi-step prediction errors: models are fitted to their predictions over windows without correction.

Over one sample even a wrong model has small errors, which process noise absorbs; over a window they add up. Each
window starts from the state of a filter with little process noise, whose gains are fixed while parameters move (Ljung,
System Identification, 1999, sections 4.4 and 8.4) and recomputed in every iteration.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from optid.core.model import Array
from optid.errors import SolveError
from optid.estimation.fisher_scoring import default_process_noise
from optid.estimation.fixed_gain import SETTLED, fixed_gain_fit, innovations
from optid.estimation.likelihood import Filtered, Noise, deviance, huber, run_filter
from optid.estimation.likelihood_point import LEVELS, LikelihoodProblem
from optid.estimation.problem import Booleans, Problem, window_numbers

# Log of the quiet filter's share of the default process noise: so little that missing physics is not absorbed by it,
# and enough to keep the states of a wrong model near the data. A nearly correct model predicts better with less.
QUIET, STEP = -2.0, -1.0
# Of the loss: beyond the requested iterations a fit continues while each gains this much, at most MOST. With
# stick-slip a fit may cross a plateau for some iterations before it reaches its optimum.
FALLING, MOST = 0.1, 12


@dataclass(frozen=True, eq=False)
class MultistepFit:
    """The result of a fit by multi-step prediction errors.

    Attributes:
        likelihood_problem: model, recordings and free parameters.
        p: the whole parameter vector.
        filtered: the quiet filter there, with the variances that windows' errors should have.
        loss: Huber's, of the windows' errors in sd.
        level: of the filter's process noise, as the log of its share of the default.
    """

    likelihood_problem: LikelihoodProblem
    p: Array
    filtered: Filtered
    loss: float
    level: float


def quiet_noise(q: LikelihoodProblem, level: float = QUIET) -> Noise:
    """Measurement noise, and process noise too small to absorb missing physics."""
    return Noise(q.measurement, q.groups, np.maximum(default_process_noise(q) + level, LEVELS[0]))


def quiet_filter(q: LikelihoodProblem, p: Array, level: float = QUIET) -> Filtered | None:
    """A filter with quiet noise; ``None`` where the simulation diverges."""
    noise = quiet_noise(q, level)
    Q = noise.spectrum(len(q.model.states))[None]
    f = run_filter(q.model, q.problem, p[None], Q, noise.measurement[None], keep=True)
    if not math.isfinite(float(deviance(f.innovations, f.variances).sum())):
        return None
    variance = noise.measurement + (0.0 if q.open_variance is None else q.open_variance)
    return replace(f, variances=np.broadcast_to(variance, f.variances.shape))


def window_starts(problem: Problem, seconds: float) -> Booleans:
    """Samples at which windows begin, (samples,); in the first window every sample, as the state is not known yet."""
    starts = np.zeros(len(problem.time), dtype=np.bool_)
    for begin, count in zip(problem.begins, problem.counts, strict=True):
        rows = slice(begin, begin + count + 1)
        number = window_numbers(problem.time[rows] - problem.time[begin], seconds)
        starts[rows] = (number == 0) | np.r_[True, np.diff(number) > 0]
    return starts


def fit_multistep(
    q: LikelihoodProblem,
    p: Array,
    seconds: float,
    *,
    turns: int,
    steps: int,
    level: float = QUIET,
    most: int = MOST,
    begun: MultistepFit | None = None,
) -> MultistepFit:
    """Fit parameters by prediction errors over windows, from a start; gains are recomputed in each iteration.

    Args:
        q: the likelihood problem.
        p: start, (parameters,).
        seconds: length of a window.
        turns: iterations, each with new gains; more while the loss falls fast.
        steps: largest number of Gauss-Newton steps per iteration.
        level: of the filter's process noise at the start, or the usual one if that predicts better; it is lowered as
            long as that predicts better.
        most: largest number of iterations.
        begun: fit of the same windows that is gone on with, in place of the start.

    Raises:
        SolveError: the model cannot be simulated at the start.
    """
    starts = window_starts(q.problem, seconds)
    best = begun or _best_of(_fit_at(q, p, starts, by) for by in {level, QUIET})
    if best is None:
        raise SolveError("the simulation diverged at the start values; check them and their units")
    lowered = True
    for turn in range(1, most + 1):
        if q.budget.is_over:
            break
        there = None
        with contextlib.suppress(SolveError):
            moved = fixed_gain_fit(q, best.p, q.model, best.filtered, steps, starts).p
            levels = (best.level, best.level + STEP) if lowered else (best.level,)
            there = _best_of(_fit_at(q, moved, starts, level) for level in levels)
        if there is None or not there.loss < best.loss:
            break
        gain, lowered = 1.0 - there.loss / best.loss, there.level < best.level
        best = there
        if gain < (SETTLED if turn < turns else FALLING):
            break
    return best


def _best_of(fits: Iterable[MultistepFit | None]) -> MultistepFit | None:
    return min((one for one in fits if one is not None), key=lambda one: one.loss, default=None)


def _fit_at(q: LikelihoodProblem, p: Array, starts: Booleans, level: float = QUIET) -> MultistepFit | None:
    """The windows' errors at some parameters, with the gains of their own filter."""
    f = quiet_filter(q, p, level)
    if f is None:
        return None
    (z,) = innovations(q, p[None], q.model, f, resets=starts)
    return MultistepFit(q, p, f, 0.5 * float(huber(z).sum()), level)


def multistep_at(q: LikelihoodProblem, p: Array, seconds: float, level: float = QUIET) -> MultistepFit:
    """Given parameters with their filter and loss, without fitting.

    Raises:
        SolveError: the model cannot be simulated.
    """
    there = _fit_at(q, p, window_starts(q.problem, seconds), level)
    if there is None:
        raise SolveError("the simulation diverged")
    return there


def multistep_loss(q: LikelihoodProblem, p: Array, seconds: float, level: float = QUIET) -> float:
    """Huber's loss of windows' errors, in sd; infinite where the simulation diverges."""
    there = _fit_at(q, p, window_starts(q.problem, seconds), level)
    return math.inf if there is None else there.loss
