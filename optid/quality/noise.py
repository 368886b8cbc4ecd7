"""Noise level and quantisation grid of a signal, estimated in the presence of motion."""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ORDER = 4  # weights of the differences: cubic motion between five samples cancels
_GOLDEN = 0.6180339887498949  # its multiples modulo 1 fill an interval evenly
_NORMAL_MEDIAN = 0.6744897501960817  # median of |z| of a standard normal
_STRETCH, _BEND = 48, 5  # samples, degree of the curve
_QUIET = 0.2  # share of stretches counted as quiet
_COLOURS = np.linspace(0.0, 0.95, 20)
_MEMORY = 8  # samples from which the next one is predicted
# Degree of the filter that takes out motion: four resonances, or cubic motion and two of them.
_ANNIHILATED = 8
_PER_WEIGHT = 20  # samples for each of its weights, and in each half
_WHITE = 0.1  # four standard deviations of the estimate from 8 s of white noise at 1 kHz
MOTION = 0.93  # a longer memory is motion that the curves did not follow
_FORETOLD = 0.5  # of the variance: what can be predicted better is motion; a quarter of coloured noise can be predicted
_HIDDEN = 0.25  # of a step: larger noise changes levels even at rest
_MANY = 500  # differences in fast motion: if there are fewer, they are mostly impacts
# Samples used for the noise of a long signal, and blocks in which they are taken.
_ENOUGH, _BLOCKS = 1 << 18, 16
_FEWEST_LEVELS = 6  # with fewer values any set looks like a grid


def noise_sd(values: Array) -> float:
    """Standard deviation of measurement noise, quantisation included, in the unit of the values.

    Robust to motion (differences of fourth order take out what is smooth over five samples) and to outliers
    and impacts (median of their size, which is not affected while fewer than one sample in ten is hit). A signal that
    rests between two levels of its grid shows no noise at all, yet its error is that of rounding, so the result is
    never below grid/sqrt(12); noise in addition to rounding shows where it moves by a step of the grid or more from
    sample to sample. Filtered noise does not show in differences; the quietest stretches show it, see `quietest`.
    Where even these contain motion, an oscillation within few samples also remains in differences: then the filter
    that cancels this motion is used, if it leaves less, see `annihilated`.

    Args:
        values: shape (samples,), evenly spaced, NaN where missing.

    Returns:
        The standard deviation; 0 with fewer than 20 complete differences.
    """
    if len(values) > _ENOUGH:
        starts = np.linspace(0, len(values) - _ENOUGH // _BLOCKS, _BLOCKS).astype(int)
        values = np.concatenate([values[a : a + _ENOUGH // _BLOCKS] for a in starts])
    step = grid(values)
    least = step / math.sqrt(12)
    beside = min(scatter(values, step, fast=True), math.hypot(least, _HIDDEN * step))
    seen, quiet = scatter(values, step), quietest(values)[0]
    if quiet == 0.0:
        seen = min(seen, annihilated(values))
    return max(seen, quiet, least, beside)


def thinned_noise(sd: float, before: Array, after: Array) -> float:
    """The remaining noise of a signal after decimation.

    It falls in proportion to the estimated noise, so that a stated one is still used. Rounding does not average out
    where the signal stays on one level of its grid during the averaging: a sweep over m levels leaves an m-th.

    Args:
        sd: of the noise before, in the unit of the values.
        before: values, (samples,), NaN where missing.
        after: the same with fewer samples.
    """
    count = max(round(len(before) / max(len(after), 1)), 1)
    seen, left = noise_sd(before), noise_sd(after)
    rest = sd * min(left / seen, 1.0) if seen > 0.0 else sd
    step = grid(before)
    whole = before[: len(before) // count * count].reshape(-1, count)
    whole = whole[np.isfinite(whole).all(axis=1)]
    if step == 0.0 or not len(whole):
        return rest
    levels = 1.0 + np.ptp(whole, axis=1) / step
    return max(rest, step / math.sqrt(12) * float(np.sqrt(np.mean(levels**-2.0))))


def scatter(values: Array, step: float = 0.0, fast: bool = False) -> float:
    """The noise from the differences alone, for `noise_sd`; `step` is the grid, 0 for none.

    With `fast` only differences over which the signal moves by a step or more from sample to sample.
    """
    differences = np.diff(values, _ORDER)
    if fast:
        differences = differences[np.abs(values[_ORDER:] - values[:-_ORDER]) >= _ORDER * step]
    differences = differences[np.isfinite(differences)]
    if differences.size < (_MANY if fast else 20):
        return 0.0
    # On a grid the median of the sizes jumps from level to level; an even spread over one step smooths it.
    dither = step * ((np.arange(differences.size) * _GOLDEN) % 1.0 - 0.5)
    size = float(np.median(np.abs(differences + dither)))
    sd = size / _NORMAL_MEDIAN
    # The spread of one step itself, of variance step^2/12, is not noise.
    variance = max(sd * sd - step * step / 12, 0.0)
    return math.sqrt(variance / math.comb(2 * _ORDER, _ORDER))


def annihilated(values: Array) -> float:
    """The residual of the filter that best cancels the motion, including white noise.

    The filter of unit norm with the smallest residual is the eigenvector of the smallest eigenvalue of the
    lagged covariance (Pisarenko 1973: for sinusoids in white noise that eigenvalue is the noise's variance). Such a
    filter keeps the variance of white noise, so that the residual is an upper bound. It is computed in each half
    and applied to the other, so that it does not fit the noise; the median of the sizes is robust to outliers.

    Returns:
        The standard deviation; infinite with too few complete samples.
    """
    lagged = np.lib.stride_tricks.sliding_window_view(values, min(_ANNIHILATED + 1, len(values)))
    lagged = lagged[np.isfinite(lagged).all(axis=1)]
    half = len(lagged) // 2
    if half < _PER_WEIGHT * (_ANNIHILATED + 1):
        return math.inf
    lagged = lagged - lagged.mean()
    left = []
    for fit, use in ((lagged[:half], lagged[half:]), (lagged[half:], lagged[:half])):
        left.append(np.abs(use @ np.linalg.eigh(fit.T @ fit)[1][:, 0]))
    return float(np.median(np.concatenate(left))) / _NORMAL_MEDIAN


def quietest(values: Array) -> tuple[float, float]:
    """Standard deviation and colour of the noise, from the stretches with the least motion.

    A smooth curve is subtracted from every stretch; those with the smallest residual are compared with stretches of
    noise of known colour, of which the same share is kept. Noise can be predicted from its own past in part only; what
    can be predicted better than `_FORETOLD` is mostly motion that the curves did not follow, such as a resonance
    within a stretch, and gives no information on noise.

    Returns:
        The standard deviation, and the correlation from sample to sample of a first-order noise, 0 where it cannot be
        distinguished from white noise; both 0 where it is motion, or there are fewer than ten complete stretches of
        `_STRETCH` samples.
    """
    count = len(values) // _STRETCH
    stretches = values[: count * _STRETCH].reshape(count, _STRETCH)
    stretches = stretches[np.isfinite(stretches).all(axis=1)]
    if len(stretches) < 10:
        return 0.0, 0.0
    correlation, power, surprise = _left(stretches)
    known = _known_noise()
    if surprise < 1.0 - _FORETOLD:
        return 0.0, 0.0
    colour = float(np.interp(correlation, known[:, 0], _COLOURS))
    if not _WHITE < colour < MOTION:
        colour = 0.0
    return math.sqrt(power / float(np.interp(colour, _COLOURS, known[:, 1]))), colour


def colour(values: Array) -> float:
    """Correlation of the measurement noise from sample to sample, 0 to 0.93; see `quietest`.

    Rounding counts as white: where it is most of the noise, the rest is ignored.
    """
    sd, found = quietest(values)
    return found if sd > 0.5 * noise_sd(values) else 0.0


def information_factor(colour: float) -> float:
    """Variance of white noise that hides slow motion as noise of this colour and unit variance does."""
    return (1.0 + colour) / (1.0 - colour)


def colour_of_factor(factor: float) -> float:
    """The inverse of `information_factor`."""
    return (factor - 1.0) / (factor + 1.0)


def decimated_noise(sd: float, colour: float, count: int) -> tuple[float, float]:
    """Sd and colour of first-order noise of which a filter kept the slow part and every `count`-th sample.

    What hides slow motion is what it was before, by `count` less samples.
    """
    left = colour**count
    return sd * math.sqrt(information_factor(colour) / information_factor(left) / count), left


def _left(stretches: Array) -> tuple[float, float, float]:
    """What curves leave of the quietest stretches: its correlation from sample to sample, its mean square sum, and the
    share of its variance that its own past does not foretell."""
    curves, _ = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, _STRETCH), _BEND + 1))
    # Around the stretch's mean: otherwise the curves lose digits of values far from zero.
    centred = stretches - stretches.mean(axis=1, keepdims=True)
    left = centred - (centred @ curves) @ curves.T
    sums = (left**2).sum(axis=1)
    quiet = sums <= np.quantile(sums, _QUIET)
    power = float(sums[quiet].mean())
    neighbours = float((left[quiet, 1:] * left[quiet, :-1]).sum())
    if power <= 0.0:
        return 0.0, 0.0, 1.0
    return neighbours / float(sums[quiet].sum()), power, _surprise(left[quiet])


def _surprise(left: Array) -> float:
    """Share of the variance of stretches that `_MEMORY` samples before do not predict, by least squares."""
    lagged = np.lib.stride_tricks.sliding_window_view(left, _MEMORY + 1, axis=1).reshape(-1, _MEMORY + 1)
    past, present = lagged[:, :-1], lagged[:, -1]
    weights = np.linalg.lstsq(past, present, rcond=None)[0]
    variance = float(present @ present)
    freedom = max(1.0 - _MEMORY / len(present), 0.1)
    missed = present - past @ weights
    return float(missed @ missed) / variance / freedom if variance > 0.0 else 1.0


@functools.cache
def _known_noise() -> Array:
    """What `_left` gives for noise of unit variance and each of `_COLOURS`, (colours, 3)."""
    white = np.random.default_rng(0).normal(size=(4000, _STRETCH))
    rows = []
    for c in _COLOURS:
        noise = white.copy()
        for n in range(1, _STRETCH):
            noise[:, n] = c * noise[:, n - 1] + math.sqrt(1.0 - c * c) * white[:, n]
        rows.append(_left(noise))
    return np.array(rows)


def grid(values: Array) -> float:
    """Step of the grid on which the values lie, 0 where there is none.

    The candidate is the smallest distance between two values, refined over all of them. On a grid every value
    then lies on a multiple; off a grid the remainders spread evenly, with a standard deviation of 0.29 steps.
    A twentieth of a step separates the two reliably and still allows for decimals cut off in a file.
    """
    levels = np.unique(values[np.isfinite(values)])
    if levels.size < _FEWEST_LEVELS:
        return 0.0
    distances = np.diff(levels)
    # Values that differ by the rounding of unit conversion are one level.
    rounding = 1e-12 * float(np.abs(levels).max())
    distances = distances[distances > rounding]
    if distances.size < _FEWEST_LEVELS - 1:
        return 0.0
    smallest = float(distances.min())
    step = float(distances.sum() / np.round(distances / smallest).sum())
    place = (levels - levels[0]) / step
    remainder = float(np.sqrt(np.mean((place - np.round(place)) ** 2)))
    return step if remainder < 0.05 else 0.0
