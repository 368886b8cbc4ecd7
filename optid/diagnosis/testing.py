"""The test: everything is frozen, and the held-out recordings are opened once.

Selection used every training recording many times. Held-out data had no part in it, so a test on them keeps its error
rate: each named effect is compared with the model without it, the whole answer with the original model.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from optid.core.model import Array
from optid.core.quantity import quantity
from optid.core.readers.own_rate import sample_stride
from optid.core.recording import Recording
from optid.diagnosis.criteria import Criteria
from optid.diagnosis.evaluation import Evaluation, evaluate
from optid.diagnosis.fitted import FittedModel
from optid.diagnosis.refinement import RefinedModel
from optid.diagnosis.residual_tests import ResidualTests, residual_tests
from optid.diagnosis.validation import p_value
from optid.errors import InputError
from optid.estimation.fixed_gain import LOST
from optid.estimation.likelihood import huber
from optid.estimation.multistep import quiet_noise
from optid.estimation.problem import SHORTEST, window_means, window_seconds


@dataclass(frozen=True)
class Evidence:
    """One model compared with another on recordings to which neither was fitted.

    Attributes:
        p_value: of the hypothesis that windows' errors do not decrease.
        fit_gain: increase of the windows' fit in percentage points, of the first output.
        error_gain: relative decrease of the windows' root mean square error, of the output that gains most.
    """

    p_value: float
    fit_gain: float
    error_gain: float


@dataclass(frozen=True, eq=False)
class HoldoutTest:
    """The result of the test on the held-out recordings.

    Attributes:
        base, best: the models on them.
        p_value: whether anything is missing at all: of the hypothesis that the best model of the search gains nothing.
        error_over_noise: of the best model's windows.
        names: evidence for every effect of the best model, by its name.
        residuals, base_residuals: tests of the residuals of the best model and of the base.
        level: error rate of each test.
        refuted: the best model does not predict better than the base, or predicts an output worse.
    """

    base: Evaluation
    best: Evaluation
    p_value: float
    error_over_noise: float
    names: Mapping[str, Evidence]
    residuals: ResidualTests
    base_residuals: ResidualTests
    level: float
    refuted: bool

    def of_base(self, noise: Mapping[str, float]) -> HoldoutTest:
        """The test with the base in place of a refuted best model."""
        ratio = self.base.error_over_noise(noise)
        return replace(self, best=self.base, error_over_noise=ratio, residuals=self.base_residuals)


def gate(recordings: Sequence[Recording], outputs: Sequence[str], commands: Sequence[str]) -> None:
    """Refuse recordings that are too short for a test, judged by their length only.

    Raises:
        InputError: names the recording and what it lacks.
    """
    for one in recordings:
        known = np.ones(len(one), dtype=np.bool_)
        for role in commands:
            known &= np.isfinite(one[role].values)
        measured = [np.where(known, one[role].values, math.nan) for role in outputs if role in one]
        # A sample of a sensor slower than the recording stands for the rows up to its next one.
        covered = [float(np.isfinite(values).sum()) * sample_stride(values) for values in measured]
        window = window_seconds(one.interval, one.duration)
        most = max(covered, default=0.0) * one.interval / window
        if most < SHORTEST:
            raise InputError(
                f"only {most:.1f} windows of {window:g} s have a command and a measured output",
                where=one.name,
                expected=f"at least {SHORTEST}: shorter recordings are too short to fit or to test on",
            )


def test_on_holdout(
    base: RefinedModel,
    best: RefinedModel,
    without: Mapping[str, FittedModel],
    strongest: FittedModel | None,
    holdout: Sequence[Recording],
    noise: Mapping[str, float],
    criteria: Criteria,
) -> HoldoutTest:
    """Open the held-out recordings, once.

    Args:
        base, best: the original model, and the selected one.
        without: effect name -> the selected model without that effect.
        strongest: the best model of the search, where nothing was selected.
        holdout: recordings.
        noise: role -> sd of the measurement, SI.
        criteria: what counts as proof.
    """
    before = _evaluated(base, holdout)
    after = before if best is base else _evaluated(best, holdout)
    challenger = after
    if best is base and strongest is not None:
        challenger = _evaluate_rival(strongest, holdout)
    p = 1.0 if challenger is before else compare(before, challenger, noise, criteria).p_value
    names = {}
    for name, less in without.items():
        there = _evaluate_rival(less, holdout) if less.effects else before
        names[name] = compare(there, after, noise, criteria)
    base_residuals = residual_tests(before, base.rig.model, holdout, criteria.level)
    residuals = (
        base_residuals if best is base else residual_tests(after, best.rig.model, holdout, criteria.level)
    )
    refuted = best is not base and (p > criteria.level or bool(worse_output(before, after, noise, criteria)))
    ratio = after.error_over_noise(noise)
    return HoldoutTest(before, after, p, ratio, names, residuals, base_residuals, criteria.level, refuted)


def worse_output(
    before: Evaluation, after: Evaluation, noise: Mapping[str, float], criteria: Criteria
) -> str:
    """An output that is predicted worse than by the original model, and worse than the noise; "" if there is none."""
    for j, (role, score) in enumerate(after.scores.items()):
        floor = noise.get(role, 0.0)
        at_noise = after.error_over_noise({role: floor}, (j,)) <= criteria.error_over_noise
        first = before.scores[role].rmse
        if not at_noise and score.rmse > (1.0 + criteria.smallest_gain) * first:
            return (
                f"{role.replace('_', ' ')} is predicted worse with it: windows have an error of "
                f"{quantity(score.rmse, score.unit)} instead of {quantity(first, score.unit)}"
            )
    return ""


def _evaluated(model: RefinedModel, recordings: Sequence[Recording]) -> Evaluation:
    return evaluate(model.fit.likelihood_problem, model.fit.p, model.fit.noise, recordings)


def _evaluate_rival(model: FittedModel, recordings: Sequence[Recording]) -> Evaluation:
    """A model that is only compared by its windows: the filter of its fit is enough."""
    q = model.likelihood_problem
    return evaluate(q, model.p, quiet_noise(q, model.fit.level), recordings)


def compare(
    before: Evaluation, after: Evaluation, noise: Mapping[str, float], criteria: Criteria
) -> Evidence:
    """The gain of a second model over a first one on the same samples."""
    at_noise = after.error_over_noise(noise) <= criteria.error_over_noise
    gains = [_windows(one, after, noise) for one in (before, after)]
    known = np.isfinite(gains[0]) & np.isfinite(gains[1])
    first = next(iter(before.scores))
    ratios = [
        after.scores[role].rmse / score.rmse for role, score in before.scores.items() if score.rmse > 0.0
    ]
    return Evidence(
        p_value(gains[0][known], gains[1][known], at_noise) if known.any() else 1.0,
        after.scores[first].fit_percent - before.scores[first].fit_percent,
        1.0 - min(ratios, default=1.0),
    )


def _windows(one: Evaluation, reference: Evaluation, noise: Mapping[str, float]) -> Array:
    """Half the mean square of each window by Huber's loss, in variances that the reference's windows should have.

    A prediction that diverged counts as `LOST` sd.
    """
    squares = np.full(one.measured.shape, math.nan)
    for j, role in enumerate(one.scores):
        floor = np.hypot(noise.get(role, 0.0), reference.expected[:, j])
        z = np.clip(one.prediction_errors(j) / np.where(floor > 0.0, floor, math.nan), -LOST, LOST)
        squares[:, j] = huber(z)
    means = window_means(squares, one.blocks)
    return np.where(np.isfinite(means).any(axis=1), 0.5 * np.nansum(means, axis=1), math.nan)
