"""Variances of many rigs at once: each of few nights, and made reliable by what the others have (empirical Bayes)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import digamma, polygamma
from scipy.stats import t

Array = NDArray[np.float64]
WIDEST = 1e6  # degrees of freedom beyond which variances are the same for all
FEWEST = 3  # rigs: of fewer nothing is drawn from others
SURE = 0.95  # that variances differ no more among rigs than is counted on: p-values far out in the tail hang on it


@dataclass(frozen=True, eq=False)
class ModeratedVariance:
    """Variances of rigs, each drawn towards what rigs have.

    Attributes
    ----------
    variance : NDArray
        of a single night, (rigs,).
    degrees : NDArray
        of freedom of these, (rigs,).
    common : float
        variance that rigs have; `prior_degrees` is how many nights' worth that counts.
    prior_degrees : float
        0 where rigs share nothing.
    """

    variance: Array
    degrees: Array
    common: float
    prior_degrees: float


def moderated(variance: Array, degrees: Array, prior_degrees: float | None = None) -> ModeratedVariance:
    """Draw sample variances towards each other.

    The variances of rigs follow a scaled inverse chi-square whose two parameters are found by the moments of their
    logarithms; the posterior mean of each is then a t statistic's variance with the degrees of both (G. K. Smyth,
    Stat. Appl. Genet. Mol. Biol. 3, 2004, section 6.2).

    Parameters
    ----------
    variance : NDArray
        sample variances, (rigs,).
    degrees : NDArray
        of freedom of each, (rigs,), more than 0.
    prior_degrees : float | None
        where several quantities tell them together; from these variances alone if absent.
    """
    variance = np.maximum(variance, 1e-12 * max(float(np.median(variance)), 1e-300))
    prior = common_degrees(variance[:, None], degrees[:, None]) if prior_degrees is None else prior_degrees
    centre = float(np.mean(_logs(variance, degrees)))
    common = float(np.exp(centre + digamma(prior / 2) - np.log(prior / 2))) if 0.0 < prior < WIDEST else 0.0
    common = common or float(np.exp(centre))
    total = degrees + prior
    return ModeratedVariance((degrees * variance + prior * common) / total, total, common, prior)


def common_degrees(variance: Array, degrees: Array) -> float:
    """Of freedom that all other rigs' variances are worth to one rig: 0 where they tell nothing.

    What the logarithms scatter beyond chance says how much rigs differ. That is taken at its upper confidence limit,
    by the scatter of it among rigs: were it taken as estimated, tails would be too thin for half of all fleets.

    Parameters
    ----------
    variance : NDArray
        sample variances, (rigs, quantities); NaN where a rig has none.
    degrees : NDArray
        of freedom of each, likewise.
    """
    count = len(variance)
    if count < FEWEST:
        return 0.0
    usual = np.maximum(np.nanmedian(variance, axis=0), 1e-300)
    e = _logs(np.maximum(variance, 1e-12 * usual), degrees)
    square = (e - np.nanmean(e, axis=0)) ** 2 * count / (count - 1) - polygamma(1, degrees / 2)
    by_rig = np.nanmean(square, axis=1)
    more = float(t.ppf(SURE, count - 1)) * float(np.std(by_rig, ddof=1)) / np.sqrt(count)
    spread = float(np.mean(by_rig)) + more
    if spread <= float(polygamma(1, WIDEST / 2)):
        return WIDEST
    return float(2.0 * brentq(lambda half: float(polygamma(1, half)) - spread, 1e-6, WIDEST))


def _logs(variance: Array, degrees: Array) -> Array:
    return np.asarray(np.log(variance) - digamma(degrees / 2) + np.log(degrees / 2))
