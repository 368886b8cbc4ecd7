"""Trends of a quantity over dates: slope with its interval, and a change-point with its p-value."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

FEWEST = 6  # dates: with fewer, neither slope nor change-point is meaningful


@dataclass(frozen=True)
class Trend:
    """The trend of a quantity of a rig.

    Attributes
    ----------
    rig, quantity : str
        of what.
    count : int
        dates.
    slope : float
        a day, in the quantity's SI unit; Theil and Sen's.
    low, high : float
        95 % interval of the slope.
    change : str
        date after which the level is another one, where the test says so at its best.
    p_change : float
        of the hypothesis that there is none.
    before, after : float
        median levels on both sides.
    """

    rig: str
    quantity: str
    count: int
    slope: float
    low: float
    high: float
    change: str
    p_change: float
    before: float
    after: float


def trends(measures: pd.DataFrame) -> pd.DataFrame:
    """The trend of every quantity of every rig with at least `FEWEST` dates, one row each.

    Parameters
    ----------
    measures : pd.DataFrame
        columns `MEASURES`; dates that pandas understands.
    """
    found = []
    for (rig, quantity), group in measures.groupby(["rig", "quantity"], sort=True):
        series = group.groupby("date", sort=True)["value"].mean()
        series = series[np.isfinite(series)]
        if len(series) >= FEWEST:
            found.append(asdict(trend(str(rig), str(quantity), series)))
    return pd.DataFrame(found, columns=list(Trend.__dataclass_fields__))


def trend(rig: str, quantity: str, series: pd.Series[float]) -> Trend:
    """The trend of one quantity.

    Slope and interval are Theil and Sen's, which a few outliers do not move (P. K. Sen, J. Amer. Statist. Assoc. 63,
    1968); the change-point is Pettitt's, which knows nothing of the noise but that nights are alike (A. N. Pettitt,
    Appl. Statist. 28, 1979).

    Parameters
    ----------
    rig : str
        whose.
    quantity : str
        what.
    series : pd.Series[float]
        by date, ascending, finite.
    """
    values = np.asarray(series, dtype=np.float64)
    days = (pd.to_datetime(series.index) - pd.to_datetime(series.index[0])) / pd.Timedelta(days=1)
    slope, _, low, high = stats.theilslopes(values, days.to_numpy(), alpha=0.95)
    at, p = change_point(values)
    before, after = float(np.median(values[:at])), float(np.median(values[at:]))
    return Trend(rig, quantity, len(values), slope, low, high, str(series.index[at]), p, before, after)


def change_point(values: NDArray[np.float64]) -> tuple[int, float]:
    """Where a series' level changes, as the index of the first value of the new one, and Pettitt's p-value.

    Parameters
    ----------
    values : NDArray
        in their order, (n,), at least two.
    """
    n = len(values)
    signs = np.sign(values[None, :] - values[:, None])
    u = np.array([signs[:t, t:].sum() for t in range(1, n)])
    at = int(np.argmax(np.abs(u)))
    p = 2.0 * np.exp(-6.0 * float(u[at]) ** 2 / (n**3 + n**2))
    return at + 1, min(float(p), 1.0)
