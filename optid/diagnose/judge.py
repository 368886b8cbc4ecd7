"""How well a fitted model predicts recordings it has not seen, and whether one predicts better than another."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from optid.core.model import Array
from optid.core.recording import Recording
from optid.core.simulation import simulate
from optid.fit.likelihood import WHOLE, deviance, run_filter
from optid.fit.prediction import HORIZON
from optid.fit.problem import Integers, Problem, pose
from optid.fit.result import Score
from optid.fit.scoring import Answer

BLOCK = 0.5  # s: samples nearer than this are not counted as independent of each other
RESAMPLES = 4000
FIDELITY = 2e-4  # share of the motion that no model is expected to follow
EXCESS = 1.25  # windows' error over the noise above which a mismatch matters


@dataclass(frozen=True, eq=False)
class Judged:
    """A model on held-out recordings: only the states are estimated.

    Attributes:
        deviance: -2 log likelihood of each sample, (samples,).
        blocks: block of `BLOCK` seconds that each sample belongs to, (samples,).
        windows: 0.5 s predictions, (samples, outputs); NaN in a recording's first 0.5 s.
        innovations: scaled to unit variance, (samples, outputs).
        measured: what was recorded, (samples, outputs).
        time: of each sample in its recording, s; `recording` says which one.
        scores: of the windows, by role.
    """

    deviance: Array
    blocks: Integers
    windows: Array
    innovations: Array
    measured: Array
    time: Array
    recording: Integers
    scores: Mapping[str, Score]

    @property
    def total(self) -> float:
        """-2 log likelihood of all."""
        return float(self.deviance.sum())


def judge(answer: Answer, recordings: Sequence[Recording]) -> Judged:
    """Filter held-out recordings with a fitted model's parameters and process noise."""
    model = answer.question.model
    problem = pose(model, recordings, WHOLE)
    Q = answer.noise.spectrum(len(model.states))[None]
    f = run_filter(model, problem, answer.p[None], Q, answer.noise.measurement[None], keep=True)
    windows = _windows(answer, recordings, problem, f.states[0])
    scores = {
        port.role: Score.of(problem.measured[:, j], windows[:, j], port.unit)
        for j, port in enumerate(model.outputs)
        if np.isfinite(problem.measured[:, j]).any()
    }
    owner = np.repeat(problem.recording, problem.counts + 1)
    blocks = np.unique(
        np.stack([owner, np.floor(problem.time / BLOCK).astype(int)]), axis=1, return_inverse=True
    )[1].ravel()
    z = f.innovations[0] / np.sqrt(f.variances[0])
    each = deviance(f.innovations[0], f.variances[0])
    return Judged(each, blocks, windows, z, problem.measured, problem.time, owner, scores)


def _windows(answer: Answer, recordings: Sequence[Recording], whole: Problem, states: Array) -> Array:
    """Predictions over windows of the contract's length from what the filter knew before each of them."""
    model = answer.question.model
    cut = pose(model, recordings, HORIZON)
    out = np.full_like(whole.measured, np.nan)
    heads = set(whole.begins.tolist())
    picked = np.array([w for w, begin in enumerate(cut.begins) if begin not in heads], dtype=int)
    if not len(picked):
        return out
    starts = cut.begins[picked]
    longest = int(cut.counts[picked].max())
    run = simulate(
        model, answer.p, states[starts], cut.dt, cut.inputs, first=starts, intervals=longest, tolerance=1e-6
    )
    for row, w in enumerate(picked):
        last = cut.counts[w] + (1 if cut.closed[w] else 0)
        out[cut.begins[w] : cut.begins[w] + last] = run.outputs[row, :last]
    return out


def excess(judged: Judged, noise: Mapping[str, float]) -> float:
    """The largest ratio of a window's error to the noise, over the channels.

    To the noise is added what no model of a rig gets right: `FIDELITY` of the channel's own spread.
    """
    ratios = []
    measured = np.flatnonzero(np.isfinite(judged.measured).any(axis=0))
    for j, (role, score) in zip(measured, judged.scores.items(), strict=True):
        floor = np.hypot(noise.get(role, 0.0), FIDELITY * float(np.nanstd(judged.measured[:, j])))
        if floor > 0.0:
            ratios.append(score.rmse / float(floor))
    return max(ratios, default=1.0)


@dataclass(frozen=True)
class Comparison:
    """One model against another on the same held-out samples.

    Attributes:
        gain: fall of -2 log likelihood from `before` to `after`.
        p_value: of the hypothesis that the mean gain of a block is not positive (bootstrap of blocks).
        fit_gain: rise of the fit in percent points of the windows, of the first output.
        error_gain: fall of the windows' root mean square error as a share, of the output that gains most.
    """

    gain: float
    p_value: float
    fit_gain: float
    error_gain: float


def compare(before: Judged, after: Judged, generator: np.random.Generator) -> Comparison:
    """What a second model gains over a first one, block by block."""
    gains = np.bincount(before.blocks, weights=before.deviance - after.deviance)
    # One block must not carry a verdict: none counts more than three times the fourth largest.
    limit = 3.0 * np.sort(np.abs(gains))[-min(4, len(gains))]
    bounded = np.clip(gains, -limit, limit)
    drawn = generator.integers(0, len(bounded), (RESAMPLES, len(bounded)))
    below = int((bounded[drawn].mean(axis=1) <= 0.0).sum())
    roles = list(before.scores)
    ratio = [after.scores[r].rmse / before.scores[r].rmse for r in roles]
    return Comparison(
        float(gains.sum()),
        (1 + below) / (1 + RESAMPLES),
        after.scores[roles[0]].fit_percent - before.scores[roles[0]].fit_percent,
        1.0 - float(np.min(ratio)),
    )
