"""Parallel elements that slip one after the other: plays of a valve, elastic parts of a seal."""

from __future__ import annotations

from typing import Any

import numpy as np

# Positions of the parts in the spread. A filter moves eight points at a time: six parts cost as much as four.
SIDES = np.linspace(-1.0, 1.0, 6)
SKEWED = SIDES**2 - float(np.mean(SIDES**2))  # leaves the mean unchanged


def shares(spread: Any, bend: Any) -> list[Any]:
    """Size of each part relative to the mean: spread evenly to both sides, the widest by `bend` more.

    Sizes are positive, so their distribution is skewed to the large ones.
    """
    return [1 + side * spread + skew * bend for side, skew in zip(SIDES, SKEWED, strict=True)]
