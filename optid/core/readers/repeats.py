"""Samples that a logger generated from a signal of a slower rate: repeats, and linear interpolation."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from optid.core.readers.glimpses import blocks

Array = NDArray[np.float64]

Change = tuple[Array, str, int]  # the channel put right, what was seen and done, the first row

_FEWEST_CHANGES = 30
_MOST_CHANGES = 0.75  # of the rows: with more, repeats cannot be distinguished from chance
_OFF_BEAT = 2.0  # rows between which changes of a slower sampling lie around an even beat
_COARSEST = 100  # rows per sample: a longer straight line is motion
_CLEAR = 10.0  # times the bend that rounding gives a straight line: a corner
_REGULAR = 0.9  # of the runs of equal values must be as long as the usual one


def stale(series: Array) -> Iterator[Change]:
    """Samples that were repeated because the signal is taken at a slower rate than the rows."""
    y = series
    if len(y) < 4 * _FEWEST_CHANGES or not np.isfinite(y).all():
        return
    if np.mean(np.concatenate([np.diff(block) != 0 for block in blocks(y)])) > _MOST_CHANGES:
        return
    steps = np.diff(y)
    changes = np.flatnonzero(steps != 0) + 1
    ratio = _rows_a_sample(changes, len(y))
    if ratio is None:
        return
    sizes = np.abs(steps[changes - 1])
    if float(np.median(sizes)) < 1.5 * float(sizes.min()) and float(np.quantile(sizes, 0.9)) < 1.5 * float(
        sizes.min()
    ):
        return  # it moves by one step of its grid at a time: slow, not stale
    yield (
        _only_at(y, np.r_[0, changes]),
        f"is updated only in every {_ordinal(ratio)} row: in between, the last value is repeated; the repeated "
        f"values do not count as samples, and its true rate is 1/{ratio:.3g} of the rows'",
        int(changes[0]),
    )


def interpolated(series: Array) -> Iterator[Change]:
    """Samples that a logger interpolated linearly between those taken at a slower rate."""
    y = series
    if len(y) < 4 * _FEWEST_CHANGES or not np.isfinite(y).all():
        return
    glimpse = np.concatenate([np.abs(np.diff(block, 2)) for block in blocks(y)])
    if float(np.median(glimpse)) > 2.1 * float(np.min(glimpse[glimpse > 0], initial=np.inf)) and float(
        np.median(glimpse)
    ) > 1e-6 * float(np.ptp(y)):
        return  # more than half of its samples are corners
    bends = np.abs(np.diff(y, 2))
    grid = float(np.min(np.abs(np.diff(np.unique(y[:20_000])))[1:], initial=np.inf))
    straight = max(1e-9 * float(np.ptp(y)), 2.1 * grid if grid < 1e-3 * float(np.ptp(y)) else 0.0)
    corners = np.flatnonzero(bends > straight) + 1
    ratio = _rows_a_sample(corners, len(y))
    if (
        ratio is None
        or not 2 <= ratio <= _COARSEST
        or float(np.median(bends[corners - 1])) < _CLEAR * straight
    ):
        return
    stride = round(ratio)
    taken = np.arange(int(corners[0]) % stride, len(y), stride)
    if abs(ratio - stride) > 0.02 or not np.isin(corners, taken).mean() > _REGULAR:
        return
    yield (
        _only_at(y, taken),
        f"runs in straight lines between every {_ordinal(ratio)} row: the logger interpolated it; the values in "
        f"between do not count as samples, and its true rate is 1/{ratio:.3g} of the rows'",
        int(taken[0]),
    )


def _only_at(y: Array, rows: NDArray[np.int64]) -> Array:
    kept = np.full(len(y), np.nan)
    kept[rows] = y[rows]
    return kept


def _rows_a_sample(changes: NDArray[np.int64], rows: int) -> float | None:
    """How many rows a sample lasts, if the changes come as regularly as those of a slower sampling do."""
    if not _FEWEST_CHANGES <= len(changes) <= _MOST_CHANGES * rows:
        return None
    apart = np.diff(changes)
    usual = round(float(np.median(apart)))
    near = np.abs(apart - usual) <= (0 if usual < 4 else 1)
    # At rest a value stays for several periods.
    whole = (apart > usual) & (
        np.abs(apart / usual - np.round(apart / usual)) * usual <= (0 if usual < 4 else 1)
    )
    if usual >= 2 and float((near | whole).mean()) >= _REGULAR + 0.05 and float(near.mean()) >= 0.6:
        return float(usual)
    ratio = float(changes[-1] - changes[0]) / (len(changes) - 1)
    off = changes - changes[0] - ratio * np.arange(len(changes))
    return ratio if float(np.ptp(off)) <= _OFF_BEAT else None


def _ordinal(ratio: float) -> str:
    n = round(ratio)
    if abs(ratio - n) > 0.02:
        return f"{ratio:.3g}th"
    end = "th" if 10 <= n % 100 <= 20 else {1: "st", 2: "nd", 3: "rd"}.get(n % 10, "th")
    return f"{n}{end}"
