"""Normal scores of nights against their reference: heavy tails are taken from the fleet, and every score is bounded.

The distance of a night from its reference, in sd, has heavy tails: some recordings are bad. The reference nights of all
rigs, each against the others of its rig, show these tails. A Student or F distribution fitted to them converts a
distance to the normal score of the same probability; sums of such scores over several nights have known tails.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]
# Nights in the sums that are compared: few detect a jump, many a slow drift; a single one may be a bad recording.
LOOKS = (2, 3, 6, 12)
CAP = 4.0  # largest normal score of a night: one in 15 000, as far as the reference nights of a fleet show its tails
TAILS = np.geomspace(1.0, 1e3, 60)  # degrees of freedom that are tried; the largest is a normal tail
SURE = 1.35  # fall of the log-likelihood up to which a heavier tail is not rejected (one-sided test at 5 %)


def tail_degrees(squares: Array, width: int) -> float:
    """Degrees of freedom of the tails: the lower limit, with 95 % confidence.

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
    """Distances of nights, scaled to the length of normal vectors of the same probability, (nights, width).

    Parameters
    ----------
    moved : NDArray
        in sd, (nights, width).
    degrees : float
        of `tail_degrees`.
    """
    width = moved.shape[1]
    squares = np.maximum(np.sum(moved**2, axis=1), 1e-12)
    rare = np.maximum(stats.f.logsf(squares / width, width, degrees), stats.chi2.logsf(CAP**2, 1))
    return np.asarray(moved * np.sqrt(stats.chi2.isf(np.exp(rare), width) / squares)[:, None])


def looks(scores: Array, reference: int) -> tuple[Array, Array]:
    """Sums of the last nights' scores in sd, (nights, looks, width), and their p-values, (nights, looks).

    NaN where there are fewer nights. All nights share the error of the reference's mean, so they are correlated.

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


def smallest_p(p: Array) -> Array:
    """The smallest p-value of each night's sums, multiplied by their number, (nights,); NaN where there is none."""
    seen = np.isfinite(p)
    best = np.where(seen, p, 1.0).min(axis=1) * seen.sum(axis=1)
    return np.where(seen.any(axis=1), np.minimum(best, 1.0), np.nan)
