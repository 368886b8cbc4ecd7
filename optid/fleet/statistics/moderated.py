"""Variances of many rigs at once: each of few nights, and made reliable by what the others have (empirical Bayes)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import digamma, polygamma
from scipy.stats import chi2

Array = NDArray[np.float64]
WIDEST = 1e6  # degrees of freedom beyond which variances are the same for all
SURE = 0.95  # that variances differ no more among rigs than is counted on: p-values far out in the tail hang on it


@dataclass(frozen=True, eq=False)
class Moderated:
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


def moderated(variance: Array, degrees: Array) -> Moderated:
    """Draw sample variances towards each other.

    The variances of rigs follow a scaled inverse chi-square whose two parameters are found by the moments of their
    logarithms; the posterior mean of each is then a t statistic's variance with the degrees of both (G. K. Smyth,
    Stat. Appl. Genet. Mol. Biol. 3, 2004, section 6.2). Of these moments the scatter is taken at its upper confidence
    limit: were it taken as estimated, tails would be too thin for half of all fleets.

    Parameters
    ----------
    variance : NDArray
        sample variances, (rigs,).
    degrees : NDArray
        of freedom of each, (rigs,), more than 0.
    """
    variance = np.maximum(variance, 1e-12 * max(float(np.median(variance)), 1e-300))
    common, prior = _prior(variance, degrees)
    total = degrees + prior
    return Moderated((degrees * variance + prior * common) / total, total, common, prior)


def _prior(variance: Array, degrees: Array) -> tuple[float, float]:
    """The common variance and its degrees of freedom."""
    if len(variance) < 3:
        return float(np.mean(variance)), 0.0
    e = np.log(variance) - digamma(degrees / 2) + np.log(degrees / 2)
    centre = float(np.mean(e))
    most = (len(e) - 1) / float(chi2.ppf(1.0 - SURE, len(e) - 1))
    spread = most * float(np.var(e, ddof=1)) - float(np.mean(polygamma(1, degrees / 2)))
    if spread <= float(polygamma(1, WIDEST / 2)):
        return float(np.exp(centre)), WIDEST
    prior = 2.0 * brentq(lambda half: float(polygamma(1, half)) - spread, 1e-6, WIDEST)
    return float(np.exp(centre + digamma(prior / 2) - np.log(prior / 2))), prior
