"""How much a night's estimate scatters: what its own interval says, and what a rig wanders from night to night."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.stats import chi2

Array = NDArray[np.float64]
LEAST, MOST = 1e-3, 1e3  # of the estimates' own variance, between which the wander's is looked for


def wander(values: Sequence[Array], sds: Sequence[Array]) -> float:
    """Variance of what rigs really wander by from night to night, the same for all.

    It makes each rig's weighted squares about its weighted mean come to as many as it has degrees of freedom, in the
    median over rigs: nights that went wrong on a few of them have no say (after Paule and Mandel 1982).

    Parameters
    ----------
    values : Sequence[NDArray]
        a rig's nights each, (nights,) of at least two.
    sds : Sequence[NDArray]
        of these, by their own intervals.
    """
    own = float(np.median(np.concatenate([sd**2 for sd in sds])))
    goal = float(np.median([chi2.ppf(0.5, len(one) - 1) / (len(one) - 1) for one in values]))

    def excess(log: float) -> float:
        more = own * 10.0**log
        return (
            float(np.median([spread(y, weights(sd, more)) for y, sd in zip(values, sds, strict=True)])) - goal
        )

    low, high = np.log10(LEAST), np.log10(MOST)
    if not own > 0.0:
        return float(np.median([np.var(one, ddof=1) for one in values])) / goal
    if excess(low) <= 0.0:
        return 0.0
    return float(own * 10.0 ** (high if excess(high) > 0.0 else brentq(excess, low, high, xtol=1e-3)))


def weights(sd: Array, more: float) -> Array:
    """Of nights with these sd, where rigs wander by a variance of `more`."""
    return np.asarray(1.0 / np.maximum(sd**2 + more, 1e-300))


def spread(values: Array, weight: Array) -> float:
    """Weighted mean square about the weighted mean: 1 where the weights are the inverse variances."""
    mean = float(weight @ values / weight.sum())
    return float(weight @ (values - mean) ** 2) / (len(values) - 1)
