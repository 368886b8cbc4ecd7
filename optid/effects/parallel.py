"""Parts in parallel that let go one after the other: plays of a valve, elastic parts of a seal."""

from __future__ import annotations

from typing import Any

import numpy as np

# Parts' places in the spread. A filter moves eight points at a time: six parts cost as much as four would.
SIDES = np.linspace(-1.0, 1.0, 6)
SKEWED = SIDES**2 - float(np.mean(SIDES**2))  # leaves the mean


def shares(spread: Any, bend: Any) -> list[Any]:
    """How large each part is, of the mean: spread evenly to either side, the widest by `bend` more than that.

    Sizes are positive, so that their distribution leans to the large ones.
    """
    return [1 + side * spread + skew * bend for side, skew in zip(SIDES, SKEWED, strict=True)]
