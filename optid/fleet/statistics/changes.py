"""Rigs that changed, night by night: p-values that stay valid for any number of looks, with controlled false alarms.

A rig's nights are compared with its own reference nights, so whatever its model has wrong from the start drops out. The
scatter of nights and its tails are measured, not assumed (`normal_scores`). Each quantity is tested alone, and all of
them together (`joint`). Three corrections follow: Bonferroni over quantities, tests and numbers of nights in a sum, a
p-value that is valid on every night, and Benjamini and Hochberg over all rigs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from optid.fleet.statistics.joint import joint
from optid.fleet.statistics.moderated import common_degrees, moderated
from optid.fleet.statistics.normal_scores import LOOKS, looks, normal_scores, smallest_p, tail_degrees
from optid.fleet.statistics.wander import spread, wander, weights

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Changes:
    """What changed.

    Attributes
    ----------
    nights : pd.DataFrame
        one row per rig and night after the reference: rig, date, p (of this night alone), `p_rig` (of the rig, valid at
        any night), q (of the fleet on that night), told (reported as changed), quantity (the most significant), t.
    told : pd.DataFrame
        one row per rig reported as changed: rig, date of the first report, quantity, t, p_rig, q, shift and sd then.
    t : pd.DataFrame
        of the last night: rigs against quantities, for the number of nights with the most significant sum.
    """

    nights: pd.DataFrame
    told: pd.DataFrame
    t: pd.DataFrame


def changes(measures: pd.DataFrame, reference: int, level: float) -> Changes:
    """Compare every rig's nights with its first ones.

    Parameters
    ----------
    measures : pd.DataFrame
        columns `MEASURES`; several of a rig, date and quantity are averaged.
    reference : int
        nights, the first of each rig, that the others are compared with.
    level : float
        largest expected share of false alarms among the rigs reported, on any night.

    Returns
    -------
    Changes
        Empty where no rig has more nights than the reference.
    """
    known = measures[np.isfinite(measures["value"]) & np.isfinite(measures["sd"])]
    nightly = known.groupby(["quantity", "rig", "date"], sort=True)[["value", "sd"]].mean()
    scores = _scores(nightly, reference)
    if scores.empty:
        empty = pd.DataFrame(columns=["rig", "date", "p", "p_rig", "q", "told", "quantity", "t"])
        return Changes(empty, empty.assign(shift=[], sd=[]), pd.DataFrame())
    together = joint(nightly, reference)
    nights = _by_fleet(_by_rig(scores, together), sorted(str(rig) for rig in known["rig"].unique()), level)
    first = nights[nights["told"]].groupby("rig", sort=True).head(1)
    about = scores.set_index(["rig", "date", "quantity"])[["shift", "sd"]]
    told = first.join(about, on=["rig", "date", "quantity"]).sort_values(["date", "rig"])
    last = scores.loc[scores.groupby(["rig", "quantity"])["date"].transform("max") == scores["date"]]
    return Changes(
        nights, told.reset_index(drop=True), last.pivot_table(index="rig", columns="quantity", values="t")
    )


class _Nights(NamedTuple):
    """Nights of one rig and quantity: dates, values, and weights."""

    rig: str
    dates: NDArray[np.object_]
    values: Array
    weights: Array


def _followed(nightly: pd.DataFrame, reference: int) -> dict[str, list[_Nights]]:
    """By quantity, the rigs that have more nights than the reference."""
    found: dict[str, list[_Nights]] = {}
    for quantity, table in nightly.groupby(level="quantity"):
        rigs = table.index.get_level_values("rig").to_numpy(dtype=object)
        starts = np.flatnonzero(np.r_[True, rigs[1:] != rigs[:-1]])
        some = [s for s in np.split(np.arange(len(rigs)), starts[1:]) if len(s) > reference]
        if not some:
            continue
        dates = table.index.get_level_values("date").to_numpy(dtype=object)
        y, sd = (table[name].to_numpy(dtype=np.float64) for name in ("value", "sd"))
        more = wander([y[s[:reference]] for s in some], [sd[s[:reference]] for s in some])
        w = weights(sd, more)
        found[str(quantity)] = [_Nights(str(rigs[s[0]]), dates[s], y[s], w[s]) for s in some]
    return found


def _scores(nightly: pd.DataFrame, reference: int) -> pd.DataFrame:
    """For each rig, night and quantity the most significant sum: its score t, p over all sums, shift and its sd."""
    followed = _followed(nightly, reference)
    if not followed:
        return pd.DataFrame()
    scatter = pd.DataFrame(
        {q: {one.rig: _spread(one, range(reference)) for one in some} for q, some in followed.items()}
    ).to_numpy(dtype=np.float64)
    prior = common_degrees(scatter, np.full(scatter.shape, reference - 1.0))
    parts = []
    for quantity, some in followed.items():
        degrees = tail_degrees(_among_reference(some, reference, prior) ** 2, 1)
        variances = _variances(some, range(reference), prior)
        parts += [
            _looked(one, variance, reference, degrees).assign(rig=one.rig, quantity=quantity)
            for one, variance in zip(some, variances, strict=True)
        ]
    return pd.concat(parts, ignore_index=True)


def _looked(one: _Nights, variance: float, reference: int, degrees: float) -> pd.DataFrame:
    """The most significant sum on each night of a rig and quantity: date, t, p, shift, sd."""
    moved, sd = _against(one, range(reference), slice(reference, None), variance)
    sums, p = looks(normal_scores((moved / sd)[:, None], degrees), reference)
    smallest = smallest_p(p)
    seen = np.isfinite(smallest)
    best = np.nanargmin(p[seen], axis=1)
    at = np.flatnonzero(seen)
    ends = [moved[max(night + 1 - LOOKS[k], 0) : night + 1] for night, k in zip(at, best, strict=True)]
    return pd.DataFrame(
        {
            "date": one.dates[reference:][seen],
            "t": sums[at, best, 0],
            "p": smallest[seen],
            "shift": [float(np.median(end)) for end in ends],
            "sd": [float(np.median(sd)) / np.sqrt(len(end)) for end in ends],
        }
    )


def _against(
    one: _Nights, base: Sequence[int], nights: slice | list[int], variance: float
) -> tuple[Array, Array]:
    """Distance of nights from the weighted mean of the base nights, and its sd."""
    w = one.weights[list(base)]
    mean = float(w @ one.values[list(base)] / w.sum())
    return one.values[nights] - mean, np.sqrt(variance * (1.0 / one.weights[nights] + 1.0 / w.sum()))


def _among_reference(some: list[_Nights], reference: int, prior: float) -> Array:
    """Each reference night against the others of its rig, in sd, (rigs times nights,)."""
    found = []
    for night in range(reference):
        others = [k for k in range(reference) if k != night]
        for one, variance in zip(some, _variances(some, others, prior), strict=True):
            moved, sd = _against(one, others, [night], variance)
            found.append(float(moved[0] / sd[0]))
    return np.array(found)


def _variances(some: list[_Nights], nights: Sequence[int], prior: float) -> Array:
    """Variance of each rig's nights relative to their weights, moderated by those of the other rigs, (rigs,)."""
    own = np.array([_spread(one, nights) for one in some])
    return moderated(own, np.full(len(own), len(nights) - 1.0), prior).variance


def _spread(one: _Nights, nights: Sequence[int]) -> float:
    return spread(one.values[list(nights)], one.weights[list(nights)])


def _by_rig(scores: pd.DataFrame, together: pd.DataFrame) -> pd.DataFrame:
    """One row per rig and night: Bonferroni over quantities, and over these and the test of all together; then over
    nights, of which the k-th may use 1 / (k (k + 1)).

    The shares sum to one, so the least of the p-values divided by them is one that may be looked at on every night,
    whatever the nights have to do with each other.
    """
    count = scores.groupby(["rig", "date"])["p"].transform("size")
    scores = scores.assign(p=(scores["p"] * count).clip(upper=1.0))
    nights = scores.loc[scores.groupby(["rig", "date"])["p"].idxmin()].sort_values(["rig", "date"])
    if len(together):
        other = nights.merge(together, on=["rig", "date"], how="left", suffixes=("", "_all"))["p_all"]
        nights["p"] = (2.0 * np.fmin(nights["p"].to_numpy(), other.to_numpy(dtype=float))).clip(max=1.0)
    k = nights.groupby("rig").cumcount() + 1
    spent = (nights["p"] * k * (k + 1)).clip(upper=1.0)
    nights = nights.assign(p_rig=spent)
    return nights.assign(p_rig=nights.groupby("rig")["p_rig"].cummin()).reset_index(drop=True)


def _by_fleet(nights: pd.DataFrame, rigs: list[str], level: float) -> pd.DataFrame:
    """The share of false ones (Benjamini and Hochberg 1995) on every night, over all rigs, the silent ones included."""
    p = nights.pivot_table(index="date", columns="rig", values="p_rig").reindex(columns=rigs)
    p = p.ffill().fillna(1.0)  # a rig without a recording keeps what it had
    q = pd.DataFrame(stats.false_discovery_control(p.to_numpy(), axis=1), index=p.index, columns=p.columns)
    long = q.reset_index().melt(id_vars="date", value_name="q")
    nights = nights.merge(long, on=["rig", "date"], how="left")
    columns = ["rig", "date", "p", "p_rig", "q", "quantity", "t"]
    return nights[columns].assign(told=nights["q"] <= level)
