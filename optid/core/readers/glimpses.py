"""The usual size of a series and its largest step, without temporary arrays of its length."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


LONG = 1 << 20  # samples: of longer series blocks show what is usual
_BLOCKS = 16


def blocks(series: Array) -> list[Array]:
    """The series, or blocks of it that are spread over a long one."""
    if len(series) <= LONG:
        return [series]
    size = LONG // _BLOCKS
    starts = np.linspace(0, len(series) - size, _BLOCKS).astype(int)
    return [series[a : a + size] for a in starts]


def largest_step(series: Array) -> float:
    """The largest change from sample to sample, missing ones left out."""
    largest, last = 0.0, np.empty(0)
    for a in range(0, len(series), LONG):
        block = series[a : a + LONG]
        known = np.concatenate((last, block[np.isfinite(block)]))
        largest = max(largest, float(np.abs(np.diff(known)).max(initial=0.0)))
        last = known[-1:]
    return largest
