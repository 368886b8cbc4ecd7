"""Which rigs have changed, by the night: p-values that stay valid however often one looks, false ones controlled.

A rig's nights are compared with its own reference nights, so whatever its model has wrong from the start drops out. The
spread between nights is measured, not assumed. Three corrections stand between that and what is told: Bonferroni over
quantities and lengths of look, a p-value that may be looked at every night, and Benjamini and Hochberg over all rigs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from optid.fleet.statistics.moderated import moderated

LOOKS = (1, 2, 4, 8, 16)  # last nights whose mean is compared: one sees a jump at once, many see a slow drift


@dataclass(frozen=True, eq=False)
class Changes:
    """What changed.

    Attributes
    ----------
    nights : pd.DataFrame
        one row a rig and night after the reference: rig, date, p (of this night alone), `p_rig` (of the rig, valid at
        any night), q (of the fleet on that night), told, quantity (the most telling), t.
    told : pd.DataFrame
        one row a rig told of: rig, date (first told), quantity, t, p_rig, q, shift and sd of the quantity then.
    t : pd.DataFrame
        of the last night: rigs against quantities, by the look that tells most.
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
        share of false rigs among those told of, at most, on any night.

    Returns
    -------
    Changes
        Empty where no rig has more nights than the reference.
    """
    nightly = measures.pivot_table(index=["rig", "quantity"], columns="date", values="value", aggfunc="mean")
    scores = _scores(nightly, reference)
    if scores.empty:
        empty = pd.DataFrame(columns=["rig", "date", "p", "p_rig", "q", "told", "quantity", "t"])
        return Changes(empty, empty.assign(shift=[], sd=[]), pd.DataFrame())
    nights = _by_fleet(_by_rig(scores), sorted(nightly.index.get_level_values("rig").unique()), level)
    first = nights[nights["told"]].groupby("rig", sort=True).head(1)
    about = scores.set_index(["rig", "date", "quantity"])[["shift", "sd"]]
    told = first.join(about, on=["rig", "date", "quantity"]).sort_values(["date", "rig"])
    last = scores.loc[scores.groupby(["rig", "quantity"])["date"].transform("max") == scores["date"]]
    return Changes(
        nights, told.reset_index(drop=True), last.pivot_table(index="rig", columns="quantity", values="t")
    )


def _scores(nightly: pd.DataFrame, reference: int) -> pd.DataFrame:
    """For each rig, night and quantity the look that tells most: t, p over looks, shift of the mean and its sd."""
    parts: dict[str, list[NDArray[Any]]] = {
        name: [] for name in ("rig", "date", "quantity", "t", "p", "shift", "sd")
    }
    for quantity, table in nightly.groupby(level="quantity"):
        rigs, dates = table.index.get_level_values("rig").to_numpy(), table.columns.to_numpy()
        known = np.isfinite(table.to_numpy(dtype=float))
        enough = np.flatnonzero(known.sum(axis=1) > reference)
        if not len(enough):
            continue
        rows = [table.to_numpy(dtype=float)[k][known[k]] for k in enough]
        first = np.array([row[:reference] for row in rows])
        spread = moderated(first.var(axis=1, ddof=1), np.full(len(rows), reference - 1.0))
        for k, row, mean, variance, degrees in zip(
            enough, rows, first.mean(axis=1), spread.variance, spread.degrees, strict=True
        ):
            shift, sd = _looks(row[reference:], float(mean), float(variance), reference)
            t = shift / sd
            pick = np.arange(len(t)), np.nanargmax(np.abs(t), axis=1)
            p = 2.0 * stats.t.sf(np.abs(t[pick]), degrees) * np.isfinite(t).sum(axis=1)
            names = (np.full(len(t), rigs[k]), dates[known[k]][reference:], np.full(len(t), quantity))
            for name, values in zip(
                parts, (*names, t[pick], np.minimum(p, 1.0), shift[pick], sd[pick]), strict=True
            ):
                parts[name].append(values)
    return pd.DataFrame({name: np.concatenate(values) for name, values in parts.items() if values})


def _looks(
    after: NDArray[np.float64], mean: float, variance: float, reference: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """How far the mean of the last nights is from the reference's, and its sd, (nights, looks); NaN where fewer."""
    total = np.concatenate([[0.0], np.cumsum(after - mean)])
    shift = np.full((len(after), len(LOOKS)), np.nan)
    for k, look in enumerate(LOOKS):
        if look <= len(after):
            shift[look - 1 :, k] = (total[look:] - total[:-look]) / look
    sd = np.sqrt(variance * (1.0 / np.array(LOOKS) + 1.0 / reference))
    return shift, np.broadcast_to(sd, shift.shape)


def _by_rig(scores: pd.DataFrame) -> pd.DataFrame:
    """One row a rig and night: Bonferroni over quantities; then over nights, of which the k-th may use 1 / (k (k + 1)).

    The shares sum to one, so the least of the p-values divided by them is one that may be looked at on every night,
    whatever the nights have to do with each other.
    """
    count = scores.groupby(["rig", "date"])["p"].transform("size")
    scores = scores.assign(p=(scores["p"] * count).clip(upper=1.0))
    nights = scores.loc[scores.groupby(["rig", "date"])["p"].idxmin()].sort_values(["rig", "date"])
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
