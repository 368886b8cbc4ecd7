"""Rigs that changed, night by night: p-values that stay valid for any number of looks, with controlled false alarms.

A rig's nights are compared with its own reference nights, so whatever its model has wrong from the start drops out. The
scatter of nights is measured, not assumed. Each quantity is tested alone and all of them together (`joint`). Three
corrections stand between that and what is told: Bonferroni over quantities, tests and lengths of look, a p-value that
may be looked at every night, and Benjamini and Hochberg over all rigs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from optid.fleet.statistics.joint import joint
from optid.fleet.statistics.moderated import common_degrees, moderated
from optid.fleet.statistics.wander import spread, wander, weights

LOOKS = (
    2,
    4,
    8,
    16,
)  # last nights whose mean is compared: few see a jump, many a slow drift; one may be a bad one
AGREE = 2.0  # sd of the other nights' mean, beyond which they agree with the one that is farthest off
FARTHEST = 10.0  # sd: a night that is farther from the reference counts as so far


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
        largest expected share of false alarms among the rigs reported, on any night.

    Returns
    -------
    Changes
        Empty where no rig has more nights than the reference.
    """
    known = measures[np.isfinite(measures["value"]) & np.isfinite(measures["sd"])]
    nightly = known.groupby(["quantity", "rig", "date"], sort=True)[["value", "sd"]].mean()
    scores, degrees = _scores(nightly, reference)
    if scores.empty:
        empty = pd.DataFrame(columns=["rig", "date", "p", "p_rig", "q", "told", "quantity", "t"])
        return Changes(empty, empty.assign(shift=[], sd=[]), pd.DataFrame())
    together = joint(nightly, reference, LOOKS, degrees)
    nights = _by_fleet(_by_rig(scores, together), sorted(str(rig) for rig in known["rig"].unique()), level)
    first = nights[nights["told"]].groupby("rig", sort=True).head(1)
    about = scores.set_index(["rig", "date", "quantity"])[["shift", "sd"]]
    told = first.join(about, on=["rig", "date", "quantity"]).sort_values(["date", "rig"])
    last = scores.loc[scores.groupby(["rig", "quantity"])["date"].transform("max") == scores["date"]]
    return Changes(
        nights, told.reset_index(drop=True), last.pivot_table(index="rig", columns="quantity", values="t")
    )


class _Night(NamedTuple):
    """Nights of one rig and quantity: dates, values, weights, and the reference's scatter about what these say."""

    rig: str
    dates: NDArray[np.object_]
    values: NDArray[np.float64]
    weights: NDArray[np.float64]
    scatter: float


def _followed(nightly: pd.DataFrame, reference: int) -> dict[str, list[_Night]]:
    """By quantity, the rigs that have more nights than the reference."""
    found: dict[str, list[_Night]] = {}
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
        found[str(quantity)] = [
            _Night(str(rigs[s[0]]), dates[s], y[s], w[s], spread(y[s[:reference]], w[s[:reference]]))
            for s in some
        ]
    return found


def _scores(nightly: pd.DataFrame, reference: int) -> tuple[pd.DataFrame, float]:
    """For each rig, night and quantity the look that tells most: t, p over looks, shift of the mean and its sd.

    Beside them the degrees of freedom of a variance.
    """
    followed = _followed(nightly, reference)
    if not followed:
        return pd.DataFrame(), 0.0
    scatter = pd.DataFrame({q: {one.rig: one.scatter for one in some} for q, some in followed.items()})
    every = scatter.to_numpy(dtype=np.float64)
    prior = common_degrees(every, np.full(every.shape, reference - 1.0))
    columns: dict[str, list[NDArray[Any]]] = {
        n: [] for n in ("rig", "date", "quantity", "t", "p", "shift", "sd")
    }
    for quantity, some in followed.items():
        own = np.array([one.scatter for one in some])
        scale = moderated(own, np.full(len(own), reference - 1.0), prior)
        for one, variance, degrees in zip(some, scale.variance, scale.degrees, strict=True):
            every_t, shift, sd = _looks(one.values, one.weights / variance, reference)
            seen = np.isfinite(every_t).any(axis=1)
            t = every_t[seen]
            if not len(t):
                continue
            pick = np.arange(len(t)), np.nanargmax(np.abs(t), axis=1)
            p = 2.0 * stats.t.sf(np.abs(t[pick]), degrees) * np.isfinite(t).sum(axis=1)
            names = (
                np.full(len(t), one.rig, object),
                one.dates[reference:][seen],
                np.full(len(t), quantity, object),
            )
            numbers = (t[pick], np.minimum(p, 1.0), shift[seen][pick], sd[seen][pick])
            for column, values in zip(columns.values(), (*names, *numbers), strict=True):
                column.append(values)
    return (
        pd.DataFrame({name: np.concatenate(some) for name, some in columns.items() if some}),
        reference - 1.0 + prior,
    )


def _looks(
    values: NDArray[np.float64], weight: NDArray[np.float64], reference: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """How far the mean of the last nights is from the reference's: t, shift and its sd, (nights, looks); NaN if fewer.

    Where the others do not agree with the night that is farthest off, what they say counts: none carries a look alone.
    """
    own = weight[:reference]
    mean, base = float(own @ values[:reference] / own.sum()), 1.0 / float(own.sum())
    after = weight[reference:]
    far = FARTHEST / np.sqrt(after)
    moved = np.clip(values[reference:] - mean, -far, far)
    t, shift, sd = (np.full((len(moved), len(LOOKS)), np.nan) for _ in range(3))
    for k, look in enumerate(LOOKS):
        if look > len(moved):
            break
        y, w = (np.lib.stride_tricks.sliding_window_view(one, look) for one in (moved, after))
        total, mass = (w * y).sum(axis=1), w.sum(axis=1)
        worst = np.arange(len(y)), np.argmax(np.abs(y) * np.sqrt(w), axis=1)
        less, left = total - (w * y)[worst], mass - w[worst]
        both = [top / mass_ / np.sqrt(1.0 / mass_ + base) for top, mass_ in ((total, mass), (less, left))]
        smaller = np.where(np.abs(both[0]) < np.abs(both[1]), both[0], both[1])
        agree = (both[0] * both[1] > 0.0) & (np.abs(both[1]) >= AGREE)
        t[look - 1 :, k] = np.where(agree | (np.abs(both[0]) < AGREE), both[0], smaller)
        shift[look - 1 :, k], sd[look - 1 :, k] = total / mass, np.sqrt(1.0 / mass + base)
    return t, shift, sd


def _by_rig(scores: pd.DataFrame, together: pd.DataFrame) -> pd.DataFrame:
    """One row a rig and night: Bonferroni over quantities, and over these and the test of all together; then over
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
