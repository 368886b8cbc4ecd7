"""How noisy a signal is and on which grid its values lie, seen through its motion."""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ORDER = 4  # of the differences: cubic motion between five samples leaves nothing behind
_GOLDEN = 0.6180339887498949  # its multiples modulo 1 fill an interval evenly
_NORMAL_MEDIAN = 0.6744897501960817  # median of |z| of a standard normal
_STRETCH, _BEND = 48, 5  # samples, degree of the curve
_QUIET = 0.2  # share of stretches counted as quiet
_COLOURS = np.linspace(0.0, 0.95, 20)
_WHITE = 0.1  # four standard deviations of what 8 s of white noise at 1 kHz seem to have
_MOTION = 0.93  # what remembers for longer is motion that the curves did not follow
_HIDDEN = 0.25  # of a step: more noise than that rattles between levels at rest, too
_MANY = 500  # differences in fast motion: fewer are mostly impacts
_FEWEST_LEVELS = 6  # with fewer values any set looks like a grid


def noise_sd(values: Array) -> float:
    """Standard deviation of measurement noise, quantisation included, in the unit of the values.

    Robust to motion (differences of fourth order take out what is smooth over five samples) and to outliers
    and impacts (median of their size, which stands firm while fewer than one sample in ten is hit). A signal
    that rests between two levels of its grid shows no noise at all, yet its error is that of rounding, so the
    result is never below grid/sqrt(12); what noise there is beside the rounding shows where it moves by a step of the
    grid or more from sample to sample. Filtered noise hides from differences; the quietest stretches show it, see
    `quietest`.

    Args:
        values: shape (samples,), evenly spaced, NaN where missing.

    Returns:
        The standard deviation; 0 where fewer than 20 differences are whole.
    """
    step = grid(values)
    least = step / math.sqrt(12)
    beside = min(scatter(values, step, fast=True), math.hypot(least, _HIDDEN * step))
    return max(scatter(values, step), quietest(values)[0], least, beside)


def scatter(values: Array, step: float = 0.0, fast: bool = False) -> float:
    """What `noise_sd` sees in the differences alone; `step` is the grid, 0 for none.

    Only in those that are `fast` if so asked, over which the signal moves by a step or more from sample to sample.
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


def quietest(values: Array) -> tuple[float, float]:
    """Standard deviation and colour of the noise, from the stretches where hardly anything moves.

    A smooth curve is taken out of every stretch; those left with the least are compared with what stretches of noise
    of known colour are left with, of which the same share is kept. What the curves leave of a fast axis at 1 kHz is
    a few micrometres at most.

    Returns:
        The standard deviation, and the correlation from sample to sample of a first-order noise, 0 where it cannot
        be told from white noise or is motion; both 0 where fewer than ten stretches of `_STRETCH` samples are whole.
    """
    count = len(values) // _STRETCH
    stretches = values[: count * _STRETCH].reshape(count, _STRETCH)
    stretches = stretches[np.isfinite(stretches).all(axis=1)]
    if len(stretches) < 10:
        return 0.0, 0.0
    correlation, power = _left(stretches)
    known = _known_noise()
    colour = float(np.interp(correlation, known[:, 0], _COLOURS))
    if not _WHITE < colour < _MOTION:
        colour = 0.0
    return math.sqrt(power / float(np.interp(colour, _COLOURS, known[:, 1]))), colour


def colour(values: Array) -> float:
    """Correlation of the measurement noise from sample to sample, 0 to 0.93; see `quietest`.

    Rounding is taken for white: where it makes up most of the noise, what little else there is does not count.
    """
    sd, found = quietest(values)
    return found if sd > 0.5 * noise_sd(values) else 0.0


def _left(stretches: Array) -> tuple[float, float]:
    """What curves leave of the quietest stretches: its correlation from sample to sample, and its mean square sum."""
    curves, _ = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, _STRETCH), _BEND + 1))
    # Around the stretch's mean: the curves would lose what a value far from zero has behind its ninth digit.
    centred = stretches - stretches.mean(axis=1, keepdims=True)
    left = centred - (centred @ curves) @ curves.T
    sums = (left**2).sum(axis=1)
    quiet = sums <= np.quantile(sums, _QUIET)
    power = float(sums[quiet].mean())
    neighbours = float((left[quiet, 1:] * left[quiet, :-1]).sum())
    return (neighbours / float(sums[quiet].sum()) if power > 0.0 else 0.0), power


@functools.cache
def _known_noise() -> Array:
    """What `_left` gives for noise of unit variance and each of `_COLOURS`, (colours, 2)."""
    white = np.random.default_rng(0).normal(size=(4000, _STRETCH))
    rows = []
    for c in _COLOURS:
        noise = white.copy()
        for n in range(1, _STRETCH):
            noise[:, n] = c * noise[:, n - 1] + math.sqrt(1.0 - c * c) * white[:, n]
        rows.append(_left(noise))
    return np.array(rows)


def grid(values: Array) -> float:
    """Step of the grid that the values lie on, 0 where there is none.

    The candidate is the smallest distance between two values, refined over all of them. On a grid every value
    then lies on a multiple; off a grid the remainders spread evenly, with a standard deviation of 0.29 steps.
    A twentieth of a step tells the two apart beyond doubt and still allows for decimals cut off in a file.
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
