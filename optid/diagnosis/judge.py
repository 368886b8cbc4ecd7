"""How well a fitted model predicts recordings it has not seen, and whether one predicts better than another."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from optid.core.filter import REACH2
from optid.core.model import Array, Model
from optid.core.recording import Recording
from optid.core.simulation import simulate
from optid.estimation.first_look import Known, first_look
from optid.estimation.likelihood import QUIET, WHOLE, Filtered, Start, deviance, run_filter
from optid.estimation.place import Answer
from optid.estimation.prediction import horizon
from optid.estimation.problem import Integers, Problem, pose
from optid.estimation.result import Score

RESAMPLES = 4000
EXCESS = 1.2  # windows' error over the noise up to which a model counts as good to the noise
NUMERICAL = (
    "numerical"  # how the source of a parameter begins that is a setting of the equations, not physics
)


@dataclass(frozen=True, eq=False)
class Judged:
    """A model on held-out recordings: only the states are estimated.

    Attributes:
        deviance: -2 log likelihood of each sample, (samples,).
        horizon: length of a window, s.
        blocks: window that each sample belongs to, (samples,); nearer ones count as dependent.
        windows: predictions over that length, (samples, outputs); NaN in a recording's first.
        innovations: scaled to unit variance, (samples, outputs).
        measured: what was recorded, (samples, outputs).
        time: of each sample in its recording, s; `recording` says which one.
        scores: of the windows, by role.
        find_open: gives `left_open`.
    """

    horizon: float
    deviance: Array
    blocks: Integers
    windows: Array
    innovations: Array
    measured: Array
    time: Array
    recording: Integers
    scores: Mapping[str, Score]
    find_open: Callable[[], Mapping[str, Array]]

    @cached_property
    def left_open(self) -> Mapping[str, Array]:
        """What the window of each sample may miss by beside the noise if nothing is missing, root mean square, SI.

        By role, (samples,); NaN where there is no window.

        The model's own smoothing leaves something open, and so do laws that stand in for nature's, such as that of
        friction at rest: the largest change where a numerical setting is halved or doubled, or a parameter of such a
        law moved within its leeway. And so does the past before a window: who does not know the pressures in which an
        axis rests does not know when it breaks away. Found when first asked for: it costs several filters, and of most
        rivals nobody asks.
        """
        return self.find_open()

    @property
    def imperfection(self) -> Mapping[str, float]:
        """The same of all windows together, by role, SI."""
        return {role: _rms(left) for role, left in self.left_open.items()}


def judge(answer: Answer, recordings: Sequence[Recording]) -> Judged:
    """Filter held-out recordings with a fitted model's parameters and process noise."""
    model = answer.question.model
    length = max(horizon(recording.interval) for recording in recordings)
    problem, cut = pose(model, recordings, WHOLE), pose(model, recordings, length)
    known = first_look(model, problem, cut, answer.p, answer.noise)

    def seen(P: Array) -> tuple[Filtered, list[Array]]:
        Q = np.tile(answer.noise.spectrum(len(model.states)), (len(P), 1))
        R, starts = np.tile(answer.noise.measurement, (len(P), 1)), known.start.times(len(P))
        f = run_filter(model, known.pieces, P, Q, R, keep=True, start=starts)
        return f, [_windows(model, p, problem, cut, X) for p, X in zip(P, f.states, strict=True)]

    f, (windows,) = seen(answer.p[None])
    scores = {
        port.role: Score.of(problem.measured[:, j], windows[:, j], port.unit)
        for j, port in enumerate(model.outputs)
        if np.isfinite(problem.measured[:, j]).any()
    }
    owner = np.repeat(problem.recording, problem.counts + 1)
    blocks = np.unique(
        np.stack([owner, np.floor(problem.time / length).astype(int)]), axis=1, return_inverse=True
    )[1].ravel()
    z = f.innovations[0] / np.sqrt(f.variances[0])
    each = deviance(f.innovations[0], f.variances[0])

    def left_open() -> dict[str, Array]:
        settings = np.concatenate([numerical_settings(answer), _within_leeway(answer)])
        others = [other - windows for other in (seen(settings)[1] if len(settings) else [])]
        unknown = _started(answer, problem, cut, known, f.states[0], windows)
        found = {}
        for j, port in enumerate(model.outputs):
            most = max((other[:, j] for other in others), key=_rms, default=0.0 * windows[:, j])
            found[port.role] = np.sqrt(_by_block(most**2 + unknown[:, j], blocks))
        return found

    return Judged(length, each, blocks, windows, z, problem.measured, problem.time, owner, scores, left_open)


def _by_block(values: Array, blocks: Integers) -> Array:
    """The mean of each sample's block; NaN stays where it is."""
    known = np.isfinite(values)
    count = np.bincount(blocks[known], minlength=int(blocks.max()) + 1)
    total = np.bincount(blocks[known], weights=values[known], minlength=len(count))
    return np.where(known, (total / np.maximum(count, 1))[blocks], np.nan)


def numerical_settings(answer: Answer) -> Array:
    """The fitted parameters with each numerical setting that is not fitted halved, and then doubled, (2 n, all)."""
    sets = []
    for i, parameter in enumerate(answer.question.model.parameters):
        if parameter.source.startswith(NUMERICAL) and i not in answer.question.free:
            for factor in (0.5, 2.0):
                sets.append(answer.p.copy())
                sets[-1][i] = np.clip(factor * answer.p[i], *parameter.bounds)
    return np.array(sets).reshape(len(sets), len(answer.p))


def _within_leeway(answer: Answer) -> Array:
    """The fitted parameters with each that has a leeway moved by it, but to its half or double at most, (2 n, all)."""
    sets = []
    for i, parameter in enumerate(answer.question.model.parameters):
        if parameter.leeway > 0.0:
            for step in (-min(parameter.leeway, answer.p[i] / 2), min(parameter.leeway, answer.p[i])):
                sets.append(answer.p.copy())
                sets[-1][i] = np.clip(answer.p[i] + step, *parameter.bounds)
    return np.array(sets).reshape(len(sets), len(answer.p))


def _rms(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else 0.0


def _windows(model: Model, p: Array, whole: Problem, cut: Problem, states: Array) -> Array:
    """Predictions over windows of the contract's length from what the filter knew before each of them."""
    out = np.full_like(whole.measured, np.nan)
    heads = set(whole.begins.tolist())
    picked = np.array([w for w, begin in enumerate(cut.begins) if begin not in heads], dtype=int)
    if not len(picked):
        return out
    starts = cut.begins[picked]
    longest = int(cut.counts[picked].max())
    run = simulate(
        model, p, states[starts], cut.dt, cut.inputs, first=starts, intervals=longest, tolerance=1e-6
    )
    for row, w in enumerate(picked):
        last = cut.counts[w] + (1 if cut.closed[w] else 0)
        out[cut.begins[w] : cut.begins[w] + last] = run.outputs[row, :last]
    return out


def _started(
    answer: Answer, whole: Problem, cut: Problem, known: Known, states: Array, windows: Array
) -> Array:
    """What windows miss, squared, where their starts are as uncertain as noise alone leaves them, (samples, outputs).

    The covariance at a start is that of a model which lacks nothing: with process noise, what is missing would count as
    uncertain. What a filter knows that begins anew was found under the model's own; so what one knows counts as well
    that follows the recording from its beginning without, where that leaves less open. The mean of the squares over a
    covariance is taken by sigma points, as the filter takes means.
    """
    model = answer.question.model
    quiet, R = np.full((1, len(model.states)), QUIET**2), answer.noise.measurement[None]
    heads = np.isin(known.pieces.begins, whole.begins)
    begun = Start(known.start.mean[:, heads], known.start.covariance[:, heads])
    least = np.full_like(windows, np.inf)
    for pieces, start in ((known.pieces, known.start), (whole, begun)):
        f = run_filter(model, pieces, answer.p[None], quiet, R, covariances=True, start=start)
        covariance = f.covariances[0, cut.begins] / np.outer(model.scales, model.scales)
        values, vectors = np.linalg.eigh(covariance)
        roots = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :] * model.scales[:, None]
        square = np.zeros_like(windows)
        for k in range(len(model.states)):
            for side in (1.0, -1.0):
                moved = states.copy()
                moved[cut.begins] += side * math.sqrt(REACH2) * roots[:, :, k]
                square += (_windows(model, answer.p, whole, cut, moved) - windows) ** 2 / (2.0 * REACH2)
        least = np.minimum(least, square)
    return least


def excess(judged: Judged, noise: Mapping[str, float]) -> float:
    """The largest ratio of windows' errors to what noise and pasts leave open, root mean square, over the channels.

    Each window counts by what is left open there: one in which an axis breaks away after a long rest does not excuse
    the others, nor are they judged by it.
    """
    ratios = []
    for j, (role, left) in enumerate(judged.left_open.items()):
        floor = np.hypot(noise.get(role, 0.0), left)
        off = judged.measured[:, j] - judged.windows[:, j]
        known = np.isfinite(off) & (floor > 0.0)
        if known.any():
            ratios.append(_rms(off[known] / floor[known]))
    return max(ratios, default=1.0)


def brought_to_noise(before: Judged, after: Judged, noise: Mapping[str, float]) -> bool:
    """Whether windows that erred beyond the noise are at it now.

    Such a gain needs no test over windows: that something is missing the noise itself shows, be it in a single window,
    and nothing is left that another effect could explain better.
    """
    return excess(before, noise) > EXCESS >= excess(after, noise)


def missed(judged: Judged, noise: Mapping[str, float]) -> float:
    """By how much windows err more than they should; 1 where they are at the noise."""
    ratio = excess(judged, noise)
    return ratio if ratio > EXCESS else 1.0


def beyond_noise(judged: Judged, noise: Mapping[str, float]) -> bool:
    """Whether windows err more than measurement does, be it for nothing but what their pasts leave open."""
    return any(score.rmse > EXCESS * noise.get(role, math.inf) for role, score in judged.scores.items())


def cleared(before: Judged, after: Judged, noise: Mapping[str, float], *, imperfect: bool = True) -> float:
    """Share of the windows' squared error beyond the floor that is gone, in the channel that had most of it.

    The floor is the noise and, of an `imperfect` model, its imperfection.
    """
    worst, share = 0.0, 1.0
    for role, score in before.scores.items():
        floor = math.hypot(noise.get(role, 0.0), before.imperfection[role] if imperfect else 0.0)
        too_much = score.rmse**2 - floor**2
        if floor > 0.0 and too_much / floor**2 > worst:
            worst = too_much / floor**2
            share = 1.0 - max(after.scores[role].rmse ** 2 - floor**2, 0.0) / too_much
    return share


@dataclass(frozen=True)
class Comparison:
    """One model against another on the same held-out samples.

    Attributes:
        gain: fall of -2 log likelihood from `before` to `after`.
        bounded_gain: the same with no window counting more than the fourth largest.
        p_value: of the hypothesis that a block's gain is not positive (bootstrap and flipped signs).
        fit_gain: rise of the windows' fit in percent points, of the first output.
        error_gain: fall of the windows' root mean square error as a share, of the output that gains most.
    """

    gain: float
    bounded_gain: float
    p_value: float
    fit_gain: float
    error_gain: float


def _window_powers(judged: Judged) -> Array:
    """Log of the mean square error of each window, summed over the outputs; 0 where a window has none."""
    square = (judged.measured - judged.windows) ** 2
    known = np.isfinite(square)
    total = np.zeros(int(judged.blocks.max()) + 1)
    for j in range(square.shape[1]):
        row = known[:, j]
        count = np.bincount(judged.blocks[row], minlength=len(total))
        power = np.bincount(judged.blocks[row], weights=square[row, j], minlength=len(total))
        seen = (count > 0) & (power > 0.0)
        total[seen] += np.log(power[seen] / count[seen])
    return total


def _bounded(gains: Array, times: float) -> Array:
    """No block counts more than so many times the fourth largest: one must not carry a verdict, nor ruin it."""
    limit = times * np.sort(np.abs(gains))[-min(4, len(gains))]
    return np.asarray(np.clip(gains, -limit, limit))


def _resampled(gains: Array, generator: np.random.Generator) -> float:
    """p-value by bootstrap of a mean that is not positive."""
    drawn = generator.integers(0, len(gains), (RESAMPLES, len(gains)))
    below = int((gains[drawn].mean(axis=1) <= 0.0).sum())
    return (1 + below) / (1 + RESAMPLES)


def _flipped(gains: Array, generator: np.random.Generator) -> float:
    """p-value of gains that might as well have the other sign, each of them (Fisher's randomisation test)."""
    signs = generator.choice((-1.0, 1.0), (RESAMPLES, len(gains)))
    above = int((signs @ gains >= gains.sum() * (1.0 - 1e-12)).sum())
    return (1 + above) / (1 + RESAMPLES)


def fit_gain(before: Judged, after: Judged) -> float:
    """By how many percent points the fit of the windows rises, of the first output."""
    first = next(iter(before.scores))
    return after.scores[first].fit_percent - before.scores[first].fit_percent


def compare(before: Judged, after: Judged, generator: np.random.Generator) -> Comparison:
    """What a second model gains over a first one, block by block.

    Three tests look, and the smallest p-value counts three times. Of the likelihood the bootstrap of the mean sees an
    effect that shows in few blocks, flipped signs one that shows in most of them while a few go astray. Flipped signs
    of the windows' errors, as logarithms, see what a model predicts better even where its filter trusts it too much.
    """
    gains = np.asarray(np.bincount(before.blocks, weights=before.deviance - after.deviance), dtype=np.float64)
    closer = _window_powers(before) - _window_powers(after)
    least = min(
        _resampled(_bounded(gains, 3.0), generator),
        _flipped(_bounded(gains, 1.0), generator),
        _flipped(_bounded(closer, 1.0), generator),
    )
    ratio = [after.scores[r].rmse / score.rmse for r, score in before.scores.items()]
    return Comparison(
        float(gains.sum()),
        float(_bounded(gains, 1.0).sum()),
        min(1.0, 3.0 * least),
        fit_gain(before, after),
        1.0 - float(np.min(ratio)),
    )
