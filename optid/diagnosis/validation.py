"""Validation of a larger model: cross-validated errors of windows, and tests with a stated error rate.

The windows of some blocks of each recording are predicted with parameters fitted to all others. A window counts once,
as its errors are correlated. Two tests examine the gain of windows. The random sign test (Pitman, Suppl. J. Roy.
Statist. Soc. 4, 1937) needs no noise model and detects an effect that shows in many windows. The likelihood ratio on
data that were not fitted detects one that shows in a window or two, if the noise is known and reached. It follows
universal inference (Wasserman, Ramdas and Balakrishnan, PNAS 117, 2020), but the smaller model is not fitted again to
the windows that judge: their bound is approximate here.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from optid.core.model import Array
from optid.diagnosis.criteria import Criteria
from optid.diagnosis.fitted import FittedModel
from optid.diagnosis.problem import DiagnosisProblem
from optid.estimation.fixed_gain import Residuals, cross_validated_residuals
from optid.estimation.likelihood import huber
from optid.estimation.multistep import window_starts
from optid.estimation.problem import Integers, cut_into, window_index, window_means
from optid.quality.noise import information_factor
from optid.rigs.rigfile import Rig

FOLDS, BLOCKS = 3, 2  # of the recordings, and blocks of each recording in a fold
# Random signs: with two or three tests the smallest p-value is half the level of one effect of the whole catalogue.
DRAWS = 20_000
CARRIED = 4  # windows are winsorised at the fourth largest, so that a single one cannot decide a verdict


@dataclass(frozen=True, eq=False)
class Validated:
    """Errors of windows with parameters fitted without them.

    Attributes:
        squares: mean of each window and each output measured in them, by Huber's loss, in variances, (windows,
            outputs); NaN in a recording's first.
        factors: variance of white noise that hides as much as each output's own, which may be coloured, (outputs,).
    """

    squares: Array
    factors: Array | float = 1.0

    @property
    def windows(self) -> Array:
        """Half the mean square of each window in variances of white noise, all outputs together, (windows,)."""
        return np.asarray(0.5 * np.nansum(self.squares / self.factors, axis=1))

    @property
    def error_over_noise(self) -> float:
        """The largest ratio of errors to the expected ones, root mean square, over the outputs."""
        return float(np.sqrt(np.max(self.by_output)))

    @property
    def by_output(self) -> Array:
        """Mean square of each output, in variances, (outputs,)."""
        return np.asarray(np.nanmean(self.squares, axis=0))

    @property
    def excess(self) -> float:
        """Mean square beyond the noise, of the output with the largest, in variances."""
        return max(self.error_over_noise**2 - 1.0, 0.0)


def cross_validate(model: FittedModel, problem: DiagnosisProblem) -> Validated:
    """A fitted model's errors over whole windows, each fold predicted with parameters fitted to the others.

    If validation recordings are named, only these, with parameters fitted to all others. The model remembers them:
    several stages ask.
    """
    if problem not in model.validated:
        model.validated[problem] = _cross_validated(model, problem)
    return model.validated[problem]


def _cross_validated(model: FittedModel, problem: DiagnosisProblem) -> Validated:
    q = model.likelihood_problem
    resets = window_starts(q.problem, problem.window)
    known = np.isfinite(model.fit.filtered.innovations[0])
    recording = np.repeat(q.problem.recording, q.problem.counts + 1)
    fold = _folds(recording, q.problem.time, problem.validation)
    residuals = Residuals(q, model.p, q.model, model.fit.filtered, resets=resets)
    z = np.full(known.shape, np.nan)
    z[known] = cross_validated_residuals(residuals, np.repeat(fold, known.sum(axis=1)))
    z[fold < 0] = np.nan
    cut = cut_into(q.problem, problem.window)
    blocks = window_index(cut)
    # The first window of a recording has no past data: it is not a prediction.
    z[np.isin(cut.begins, q.problem.begins)[blocks]] = np.nan
    factors = np.array([_information_factor(q.rig, port.role) for port in q.model.outputs])
    variances = model.fit.filtered.variances[0]
    own = variances - q.measurement * (1.0 - 1.0 / factors)
    squares = window_means(huber(z * np.sqrt(variances / own)), blocks)
    seen = np.isfinite(squares)
    windows, outputs = seen.any(axis=1), seen.any(axis=0)
    return Validated(squares[np.ix_(windows, outputs)], factors[outputs])


def _information_factor(rig: Rig, role: str) -> float:
    return information_factor((rig.channels[role].colour if role in rig.channels else None) or 0.0)


def _folds(recording: Integers, time: Array, validation: Sequence[int]) -> Integers:
    """The fold of each sample, from the block of its recording; -1 where it is not used for validation.

    Every fold has blocks of every recording: an effect may act in one of them only, and could then not be fitted from
    the others.
    """
    if validation:
        return np.where(np.isin(recording, validation), 0, -1)
    fold = np.empty(len(time), dtype=np.int64)
    for one in np.unique(recording):
        here = recording == one
        share = (time[here] - time[here].min()) / max(float(np.ptp(time[here])), 1e-300)
        fold[here] = np.minimum((FOLDS * BLOCKS * share).astype(np.int64), FOLDS * BLOCKS - 1) % FOLDS
    return fold


def p_value(before: Array, after: Array, at_noise: bool) -> float:
    """p-value of the hypothesis that windows (windows,) gain nothing; each is half a mean square in variances.

    The smallest of two or three tests, corrected for their number: flipped signs of the gains and of their logarithms,
    and, where the second model reaches the noise, the likelihood ratio.
    """
    gains, ratio = before - after, np.log(np.maximum(before, 1e-12) / np.maximum(after, 1e-12))
    tests = [flipped_signs(gains), flipped_signs(ratio)]
    if at_noise:
        tests.append(max(math.exp(-max(float(gains.sum()), 0.0)), sys.float_info.min))
    return min(1.0, len(tests) * min(tests))


def flipped_signs(gains: Array) -> float:
    """p-value of gains under random signs.

    The share of random signs whose total reaches the observed one, which is included, so that the p-value is valid for
    any number of draws (Phipson and Smyth, Statist. Appl. Genet. Mol. Biol. 9, 2010).
    """
    limit = np.sort(np.abs(gains))[-min(CARRIED, len(gains))]
    if not limit > 0.0:
        return 1.0
    bounded = (np.clip(gains, -limit, limit) / limit).astype(np.float32)
    reached = _signs(len(gains)) @ np.abs(bounded) >= float(bounded.sum()) * (1.0 - 1e-5)
    return (1.0 + float(np.count_nonzero(reached))) / (1.0 + DRAWS)


@lru_cache(maxsize=4)
def _signs(count: int) -> NDArray[np.float32]:
    """Random signs, (DRAWS, count)."""
    drawn = np.random.default_rng(0).integers(0, 2, (DRAWS, count), dtype=np.int8)
    return (2.0 * drawn - 1.0).astype(np.float32)


def error_gain(before: Validated, after: Validated) -> float:
    """Relative decrease of the root mean square error, of the output that gains most."""
    ratio = np.sqrt(
        np.nanmean(after.squares, axis=0) / np.maximum(np.nanmean(before.squares, axis=0), 1e-300)
    )
    return 1.0 - float(np.min(ratio))


def rejection_reason(
    size: float,
    first: Validated,
    before: Validated,
    after: Validated,
    criteria: Criteria,
    tried: int,
    alone: bool,
) -> str:
    """Why an effect is rejected in addition to those before it; empty if it is accepted.

    Args:
        size: of the new effect, in smallest sizes worth a name.
        first, before, after: the original model, and those without and with the new effect.
        criteria: what counts as proof.
        tried: number of effects among which it was found.
        alone: whether it is the only one.
    """
    at_noise = after.error_over_noise <= criteria.error_over_noise
    # Beyond the noise something is certainly missing, and only chance must be ruled out; at the noise each of all
    # effects tried may have gained something by chance.
    missing = before.error_over_noise > criteria.error_over_noise
    # An effect that alone brings a model from beyond the noise to it is needed, however small it is.
    if size < 1.0 and not (alone and missing and at_noise):
        return f"the fit leaves it at {100 * size:.0f} % of the smallest size worth a name"
    p = p_value(before.windows, after.windows, at_noise)
    asked = criteria.level if missing else criteria.level / max(tried, 1)
    if not p <= asked:
        return (
            f"its gain on windows that were not fitted may be chance (p = {p:.2g}; {asked:.2g} is required)"
        )
    gain = error_gain(before, after)
    if not gain >= criteria.smallest_gain:
        return f"cross-validated, the error of the windows falls by {100 * max(gain, 0):.1f} %: too little to matter"
    if not alone:
        more = before.excess - after.excess
        if not at_noise and more < min(criteria.smallest_share * first.excess, 0.5 * before.excess):
            return (
                f"it explains {100 * max(more, 0) / max(first.excess, 1e-12):.1f} % of the squared error of the "
                "base model: "
                "the effects chosen before it may leave as much, if their form is not exact"
            )
    return ""
