"""A model on recordings: the errors of its windows, and those that even a correct model would have."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from optid.core.ddf2 import REACH2
from optid.core.model import Array, Model
from optid.core.recording import Recording
from optid.estimation.likelihood import (
    QUIET,
    WHOLE,
    Filtered,
    Noise,
    run_filter,
    run_fixed_gain_filter,
    run_windows,
)
from optid.estimation.likelihood_point import LikelihoodProblem
from optid.estimation.moving_horizon import predict_windows
from optid.estimation.multistep import window_starts
from optid.estimation.objective import objective_of
from optid.estimation.prediction import PROCESS_NOISE
from optid.estimation.problem import (
    Booleans,
    Integers,
    Problem,
    build_problem,
    cut_into,
    window_index,
    window_means,
    window_seconds,
)
from optid.estimation.result import Score

NUMERICAL = "numerical"  # start of `source` for a parameter that is a numerical setting of the equations


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A model on recordings: only the states are estimated.

    Attributes:
        horizon: length of a window, s.
        blocks: window that each sample belongs to, (samples,).
        windows: predictions over that length, (samples, outputs); NaN in a recording's first.
        innovations: scaled to unit variance, (samples, outputs).
        measured: what was recorded, (samples, outputs).
        time: of each sample in its recording, s; `recording` says which one.
        scores: of the windows, by role.
        expected: expected root mean square error of each window, apart from the noise, of a correct model, (samples,
            outputs).
    """

    horizon: float
    blocks: Integers
    windows: Array
    innovations: Array
    measured: Array
    time: Array
    recording: Integers
    scores: Mapping[str, Score]
    expected: Array

    def error_over_noise(self, noise: Mapping[str, float], outputs: Sequence[int] | None = None) -> float:
        """The largest ratio of windows' errors to those of a correct model, root mean square, over the channels.

        NaN where no window was predicted, or the simulation diverged in one. `outputs` restricts the channels.
        """
        ratios = []
        for j, role in enumerate(self.scores):
            if outputs is not None and j not in outputs:
                continue
            floor = np.hypot(noise.get(role, 0.0), self.expected[:, j])
            ratios.append(
                _rms(
                    (self.prediction_errors(j) / np.where(floor > 0.0, floor, math.nan))[
                        self._should_be_predicted(j)
                    ]
                )
            )
        most = float(np.max(ratios)) if ratios else math.nan
        return most if math.isfinite(most) else math.nan

    def expected_errors(self, noise: Mapping[str, float]) -> dict[str, float]:
        """Root mean square error of a correct model's windows by role: noise, and starts that are not known exactly."""
        return {
            role: _rms(np.hypot(noise.get(role, 0.0), self.expected[self._should_be_predicted(j), j]))
            for j, role in enumerate(self.scores)
        }

    def prediction_errors(self, output: int) -> Array:
        """Measured less predicted, (samples,); infinite where a prediction diverged, NaN where there should be none."""
        off = self.measured[:, output] - self.windows[:, output]
        return np.where(self._should_be_predicted(output) & ~np.isfinite(off), math.inf, off)

    def _should_be_predicted(self, output: int) -> Booleans:
        """Measured samples of windows that should be predicted, (samples,)."""
        return np.isfinite(self.measured[:, output]) & np.isfinite(self.expected[:, output])


def open_variance(q: LikelihoodProblem, p: Array, noise: Noise, length: float) -> Array:
    """Expected variance of windows' errors apart from the noise, (samples, outputs); 0 where unknown."""
    whole = q.problem
    cut = cut_into(whole, length)
    Q, R = noise.spectrum(len(q.model.states))[None], noise.measurement[None]
    f = run_filter(q.model, whole, p[None], Q, R, keep=True)
    QR = np.full((1, len(q.model.states)), QUIET**2), noise.measurement[None]
    sure = run_filter(q.model, whole, p[None], *QR, covariances=True)
    # The covariance of a correct model: with process noise, missing physics would count as uncertainty.
    starts = f.states[0, cut.begins], sure.covariances[0, cut.begins]
    square = _setting_errors(q, p, whole, f, length) ** 2 + _start_errors(q.model, p, whole, cut, *starts)
    index = window_index(cut)
    return np.nan_to_num(window_means(square, index)[index])


def evaluate(q: LikelihoodProblem, p: Array, noise: Noise, recordings: Sequence[Recording]) -> Evaluation:
    """Filter recordings with fixed parameters, and predict their windows as `predict` does."""
    model = q.model
    length = max(window_seconds(recording.interval, recording.duration) for recording in recordings)
    problem, cut = build_problem(model, recordings, WHOLE), build_problem(model, recordings, length)
    Q, R = noise.spectrum(len(model.states))[None], noise.measurement[None]
    f = run_filter(model, problem, p[None], Q, R, keep=True)
    predicted = predict_windows(objective_of(q.rig, (), cut)[0], p, PROCESS_NOISE * model.scales)
    windows = predicted.outputs
    outputs = [(j, port) for j, port in enumerate(model.outputs) if np.isfinite(problem.measured[:, j]).any()]
    scores = {port.role: Score.of(problem.measured[:, j], windows[:, j], port.unit) for j, port in outputs}
    owner = np.repeat(problem.recording, problem.counts + 1)
    blocks = window_index(cut)
    z = f.innovations[0] / np.sqrt(f.variances[0])
    square = _setting_errors(q, p, problem, f, length) ** 2 + _start_errors(
        model, p, problem, cut, predicted.starts, predicted.covariances
    )
    # A diverging prediction has no finite error, and no claim can be based on it.
    expected = np.where(
        _predicted(problem, cut)[:, None],
        np.nan_to_num(np.sqrt(window_means(square, blocks)[blocks])),
        np.nan,
    )
    used = [j for j, _ in outputs]
    return Evaluation(
        length,
        blocks,
        windows[:, used],
        z[:, used],
        problem.measured[:, used],
        problem.time,
        owner,
        scores,
        expected[:, used],
    )


def _setting_errors(q: LikelihoodProblem, p: Array, problem: Problem, f: Filtered, length: float) -> Array:
    """The largest change of windows, by output, for a numerical setting changed by 2 or a law within its leeway."""
    sets = np.concatenate([numerical_settings(q, p), _within_leeway(q, p)])
    own = range(len(q.model.states))
    E = run_fixed_gain_filter(
        q.model, problem, np.concatenate([p[None], sets]), f, own, resets=window_starts(problem, length)
    )
    if len(E) < 2:
        return np.zeros(E.shape[1:])
    with np.errstate(invalid="ignore"):  # a setting that makes the simulation diverge is ignored
        changes = np.where(np.isfinite(E[1:] - E[0]), E[1:] - E[0], 0.0)
    most = np.argmax(np.sqrt(np.mean(changes**2, axis=1)), axis=0)
    return np.stack([changes[k, :, j] for j, k in enumerate(most)], axis=1)


def numerical_settings(q: LikelihoodProblem, p: Array) -> Array:
    """The fitted parameters with each numerical setting that is not fitted halved, and then doubled, (2 n, all)."""
    sets = []
    for i, parameter in enumerate(q.model.parameters):
        if parameter.source.startswith(NUMERICAL) and i not in q.free:
            for factor in (0.5, 2.0):
                sets.append(p.copy())
                sets[-1][i] = np.clip(factor * p[i], *parameter.bounds)
    return np.array(sets).reshape(len(sets), len(p))


def _within_leeway(q: LikelihoodProblem, p: Array) -> Array:
    """The fitted parameters with each that has a leeway moved by it, at most to its half or double, (2 n, all)."""
    sets = []
    for i, parameter in enumerate(q.model.parameters):
        if parameter.leeway > 0.0:
            for step in (-min(parameter.leeway, p[i] / 2), min(parameter.leeway, p[i])):
                sets.append(p.copy())
                sets[-1][i] = np.clip(p[i] + step, *parameter.bounds)
    return np.array(sets).reshape(len(sets), len(p))


def _rms(values: Array) -> float:
    """Root mean square of those that are not NaN; NaN if none is."""
    known = values[~np.isnan(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else math.nan


def _predicted(whole: Problem, cut: Problem) -> Booleans:
    """Samples of windows with past data, (samples,)."""
    heads, known = set(whole.begins.tolist()), np.zeros(len(whole.time), dtype=np.bool_)
    for begin, count, closed in zip(
        cut.begins.tolist(), cut.counts.tolist(), cut.closed.tolist(), strict=True
    ):
        if begin not in heads:
            known[begin : begin + count + int(closed)] = True
    return known


def _start_errors(
    model: Model, p: Array, whole: Problem, cut: Problem, starts: Array, covariances: Array
) -> Array:
    """Squared error of windows due to the uncertainty of their starts, (samples, outputs).

    The mean square over a covariance is computed with sigma points, as in the filter.

    Args:
        model: and `p`, its parameters.
        whole: recordings, and `cut`, their windows.
        starts: states where windows begin, (windows, states), with their `covariances`.
    """
    values, vectors = np.linalg.eigh(np.nan_to_num(covariances / np.outer(model.scales, model.scales)))
    roots = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :] * model.scales[:, None]
    aside = math.sqrt(REACH2) * np.moveaxis(roots, 2, 0)
    heads = np.flatnonzero(~np.isin(cut.begins, whole.begins)).tolist()
    outputs = run_windows(
        model, cut, p, np.concatenate([starts[None], starts + aside, starts - aside]), heads
    )
    return np.asarray(((outputs[1:] - outputs[0]) ** 2).sum(axis=0) / (2.0 * REACH2))
