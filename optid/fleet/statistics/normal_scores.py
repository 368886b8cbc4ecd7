"""Nights against their reference as normal scores: tails as heavy as the fleet's own, and no night counts without end.

How far a night is from its reference, in sd, has heavier tails than any textbook's: some nights go wrong. The reference
nights of all rigs, each against the others of its rig, show these tails; a Student or F distribution fitted to them
turns a distance into the normal one that is as rare. Means over the last nights of such scores have known tails.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]
LOOKS = (
    2,
    3,
    6,
    12,
)  # last nights whose mean is compared: few see a jump, many a slow drift; one may be a bad one
CAP = 4.0  # normal score of one night at most: one in 15 000, about what a fleet's reference nights can tell of tails
TAILS = np.geomspace(1.0, 1e3, 60)  # degrees of freedom that are tried; beyond these a tail is normal
SURE = 1.35  # of the log-likelihood below its maximum: the heaviest tail that a one-sided test at 5 % does not reject


def tail(squares: Array, width: int) -> float:
    """Degrees of freedom of the tails: as heavy as the distances may be, 95 % sure.

    Parameters
    ----------
    squares : NDArray
        squared distances of reference nights from the others of their rig, in variances, (nights,).
    width : int
        of what is compared: 1 for one quantity.
    """
    ratio = np.maximum(squares / width, 1e-12)
    likelihood = np.array([float(stats.f.logpdf(ratio, width, one).sum()) for one in TAILS])
    return float(TAILS[np.argmax(likelihood >= likelihood.max() - SURE)])


def normal_scores(moved: Array, degrees: float) -> Array:
    """Distances of nights, (nights, width), with their lengths made those of normal vectors that are as rare.

    Parameters
    ----------
    moved : NDArray
        in sd, (nights, width).
    degrees : float
        of `tail`.
    """
    width = moved.shape[1]
    squares = np.maximum(np.sum(moved**2, axis=1), 1e-12)
    rare = np.maximum(stats.f.logsf(squares / width, width, degrees), stats.chi2.logsf(CAP**2, 1))
    return np.asarray(moved * np.sqrt(stats.chi2.isf(np.exp(rare), width) / squares)[:, None])


def looks(scores: Array, reference: int) -> tuple[Array, Array]:
    """Sums of the last nights' scores in sd, (nights, looks, width), and their p-values, (nights, looks).

    NaN where there are fewer nights. All nights share the reference's mean and its error, so they go together a little.

    Parameters
    ----------
    scores : NDArray
        normal scores, (nights, width).
    reference : int
        nights, whose mean the others are compared with.
    """
    nights, width = scores.shape
    shared = 1.0 / (1.0 + reference)
    sums = np.full((nights, len(LOOKS), width), np.nan)
    for k, look in enumerate(LOOKS):
        if look <= nights:
            windows = np.lib.stride_tricks.sliding_window_view(scores, look, axis=0)
            sums[look - 1 :, k] = windows.sum(axis=2) / np.sqrt(look * (1.0 + (look - 1.0) * shared))
    return sums, np.asarray(stats.chi2.sf(np.sum(sums**2, axis=2), width))


def least(p: Array) -> Array:
    """The least p-value of each night's looks, multiplied by their number, (nights,); NaN where there is none."""
    seen = np.isfinite(p)
    best = np.where(seen, p, 1.0).min(axis=1) * seen.sum(axis=1)
    return np.where(seen.any(axis=1), np.minimum(best, 1.0), np.nan)
