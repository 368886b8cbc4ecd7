"""Comparison of similar rigs: which differ from the others, and what all share."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats
from scipy.optimize import brentq

from optid.fleet.statistics.moderated import moderated
from optid.fleet.statistics.wander import spread, wander, weights

Array = NDArray[np.float64]
FEWEST = 4  # rigs: among fewer none can be unlike the others


def levels(measures: pd.DataFrame, reference: int) -> pd.DataFrame:
    """Each rig's level of a quantity over its first dates: weighted mean, its variance, and how many dates.

    Parameters
    ----------
    measures : pd.DataFrame
        columns `MEASURES`.
    reference : int
        dates, the first of each rig; of a rig with a single one the variance is what its `sd` says.
    """
    found = []
    known = measures[np.isfinite(measures["value"])].assign(sd=lambda table: table["sd"].fillna(0.0))
    nightly = known.groupby(["quantity", "rig", "date"], sort=True)[["value", "sd"]].mean()
    for quantity, table in nightly.groupby(level="quantity"):
        rigs = {
            str(rig): some.head(reference).to_numpy(dtype=np.float64).T
            for rig, some in table.groupby(level="rig")
        }
        several = [one for one in rigs.values() if one.shape[1] > 1]
        more = wander([y for y, _ in several], [sd for _, sd in several]) if several else 0.0
        for rig, (y, sd) in rigs.items():
            weight = weights(sd, more)
            scale = spread(y, weight) if len(y) > 1 else 1.0
            found.append(
                (rig, str(quantity), float(weight @ y / weight.sum()), scale / float(weight.sum()), len(y))
            )
    return pd.DataFrame(found, columns=["rig", "quantity", "value", "variance", "count"])


def unlike(table: pd.DataFrame, level: float) -> pd.DataFrame:
    """Rigs compared with their siblings, one row per rig and quantity, significant or not.

    A rig's level is compared with the median of the others; the spread among rigs is their median absolute deviation,
    which no outlier widens. Benjamini and Hochberg over all rigs and quantities.

    Parameters
    ----------
    table : pd.DataFrame
        of `levels`, of siblings alone.
    level : float
        expected share of false alarms among those reported.
    """
    parts = []
    for _, group in table.groupby("quantity", sort=True):
        known = group[np.isfinite(group["value"])]
        if len(known) < FEWEST:
            continue
        values = known["value"].to_numpy()
        spread = float(stats.median_abs_deviation(values, scale="normal"))
        if not spread > 0.0:
            continue
        z = (values - float(np.median(values))) / spread
        # A spread by the median absolute deviation is worth 0.37 as many values as the sample variance is.
        p = 2.0 * stats.t.sf(np.abs(z), max(0.37 * (len(known) - 1), 1.0))
        parts.append(known.assign(usual=float(np.median(values)), z=z, p=p))
    if not parts:
        return pd.DataFrame(columns=[*table.columns, "usual", "z", "p", "q", "told"])
    found: pd.DataFrame = pd.concat(parts, ignore_index=True)
    q = np.asarray(stats.false_discovery_control(found["p"].to_numpy()))
    found["q"], found["told"] = q, q <= level
    return found


def pooled(table: pd.DataFrame) -> pd.DataFrame:
    """What siblings share of each quantity, and how much the estimate of each gains by it: partial pooling.

    A rig's level is drawn towards the common one by as much as rigs differ less than the estimates scatter (random
    effects; the variance among rigs by Paule and Mandel, J. Res. NBS 87, 1982).

    Parameters
    ----------
    table : pd.DataFrame
        of `levels`, of siblings alone.

    Returns
    -------
    pd.DataFrame
        One row per quantity: rigs, common value with its 95 % interval, `among` (sd among rigs), `within` (median sd of
        a rig's own estimate), gain (share by which pooling lowers the variance of a rig's estimate, mean).
    """
    found = []
    for quantity, group in table.groupby("quantity", sort=True):
        known = group[np.isfinite(group["value"]) & (group["variance"] > 0.0)]
        if len(known) < FEWEST:
            continue
        y, v = known["value"].to_numpy(), _steady(known["variance"].to_numpy(), known["count"].to_numpy())
        among = variance_among(y, v)
        weight = 1.0 / (v + among)
        common, sd = float(weight @ y / weight.sum()), float(1.0 / np.sqrt(weight.sum()))
        share = among / (among + v)  # of a rig's own estimate that stays
        variance = share * v + (1.0 - share) ** 2 * sd**2
        half = float(stats.norm.ppf(0.975)) * sd
        within = float(np.sqrt(np.median(v)))
        gain = 1.0 - float(np.mean(variance / v))
        row = (
            quantity,
            len(known),
            common,
            common - half,
            common + half,
            float(np.sqrt(among)),
            within,
            gain,
        )
        found.append(row)
    columns = ["quantity", "rigs", "common", "low", "high", "among", "within", "gain"]
    return pd.DataFrame(found, columns=columns)


def shrunken(y: Array, v: Array) -> Array:
    """Estimates (rigs,) drawn towards their common value, from their variances (rigs,)."""
    among = variance_among(y, v)
    weight = 1.0 / (v + among)
    common = float(weight @ y / weight.sum())
    return np.asarray(common + among / (among + v) * (y - common))


def variance_among(y: Array, v: Array) -> float:
    """Of the true values among rigs: with it their weighted squares come to the degrees of freedom."""

    def excess(among: float) -> float:
        weight = 1.0 / (v + among)
        return float(weight @ (y - weight @ y / weight.sum()) ** 2) - (len(y) - 1)

    most = float(np.var(y, ddof=1)) * len(y) + 1e-300
    if excess(0.0) <= 0.0:
        return 0.0
    return float(brentq(excess, 0.0, most, xtol=1e-12 * most)) if excess(most) < 0.0 else most


def _steady(variance: Array, count: Array) -> Array:
    """Variances of few dates each, drawn towards each other."""
    several = count > 1
    if several.all() and len(variance):
        return np.asarray(moderated(variance, count - 1.0).variance)
    return variance
