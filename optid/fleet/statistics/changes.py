"""Which rigs have changed, by the night: p-values that stay valid however often one looks, false ones controlled.

A rig's nights are compared with its own reference nights, so whatever its model has wrong from the start drops out. The
spread between nights is measured, not assumed. Three corrections stand between that and what is told: Bonferroni over
quantities and lengths of look, a p-value that may be looked at every night, and Benjamini and Hochberg over all rigs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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
    found = []
    for quantity, table in nightly.groupby(level="quantity"):
        rows = [(str(rig), _known(row)) for (rig, _), row in table.iterrows()]
        rows = [(rig, row) for rig, row in rows if len(row) > reference]
        if not rows:
            continue
        first = [row.to_numpy()[:reference] for _, row in rows]
        spread = moderated(
            np.array([np.var(one, ddof=1) for one in first]), np.full(len(rows), reference - 1.0)
        )
        for (rig, row), own, variance, degrees in zip(
            rows, first, spread.variance, spread.degrees, strict=True
        ):
            after = row.iloc[reference:]
            shift, sd = _looks(after.to_numpy(), float(own.mean()), float(variance), reference)
            t = shift / sd
            best = np.nanargmax(np.abs(t), axis=1)
            pick = np.arange(len(after)), best
            p = 2.0 * stats.t.sf(np.abs(t[pick]), degrees) * np.isfinite(t).sum(axis=1)
            found.append(
                pd.DataFrame(
                    {
                        "rig": rig,
                        "date": after.index,
                        "quantity": str(quantity),
                        "t": t[pick],
                        "p": np.minimum(p, 1.0),
                        "shift": shift[pick],
                        "sd": sd[pick],
                    }
                )
            )
    return pd.concat(found, ignore_index=True) if found else pd.DataFrame()


def _known(row: pd.Series[float]) -> pd.Series[float]:
    return row[np.isfinite(row.to_numpy(dtype=float))]


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
    scores = scores.assign(p=np.minimum(scores["p"] * count, 1.0))
    nights = scores.loc[scores.groupby(["rig", "date"])["p"].idxmin()].sort_values(["rig", "date"])
    k = nights.groupby("rig").cumcount() + 1
    spent = np.minimum(nights["p"] * k * (k + 1), 1.0)
    return nights.assign(p_rig=spent.groupby(nights["rig"]).cummin()).reset_index(drop=True)


def _by_fleet(nights: pd.DataFrame, rigs: Sequence[str], level: float) -> pd.DataFrame:
    """The share of false ones (Benjamini and Hochberg 1995) on every night, over all rigs, the silent ones included."""
    p = nights.pivot_table(index="date", columns="rig", values="p_rig").reindex(columns=rigs)
    p = p.ffill().fillna(1.0)  # a rig without a recording keeps what it had
    q = pd.DataFrame(stats.false_discovery_control(p.to_numpy(), axis=1), index=p.index, columns=p.columns)
    long = q.reset_index().melt(id_vars="date", value_name="q")
    nights = nights.merge(long, on=["rig", "date"], how="left")
    columns = ["rig", "date", "p", "p_rig", "q", "quantity", "t"]
    return nights[columns].assign(told=nights["q"] <= level)
