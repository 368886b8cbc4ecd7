"""Figures of a fleet: rigs against quantities, rigs reported by night, and the trend of one quantity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from optid.report.figures import ALARM, FREE, INK, QUIET, STYLE, WINDOW, axis_name

FARTHEST = 12.0  # sd at which a cell has the darkest colour
MOST = 60  # rigs in an overview: those reported, and then those that changed most


def overview(t: pd.DataFrame, told: Sequence[str]) -> Figure:
    """Rigs against quantities: by how many sd the last nights differ from the reference."""
    with rc_context(STYLE):
        count = min(len(t), MOST)
        figure = Figure(figsize=(9.2, 1.6 + 0.18 * count), layout="constrained")
        heatmap(figure.subplots(), t, told)
        return figure


def heatmap(axes: Axes, t: pd.DataFrame, told: Sequence[str]) -> None:
    """Cells on axes: red above the reference, blue below; reported rigs are at the top."""
    table = t.set_index("rig")
    moved = table.abs().max(axis=1)
    order = sorted(table.index, key=lambda rig: (rig not in told, -float(moved[rig])))[:MOST]
    values = np.clip(table.loc[order].to_numpy(dtype=float), -FARTHEST, FARTHEST)
    axes.imshow(values, cmap="RdBu_r", vmin=-FARTHEST, vmax=FARTHEST, aspect="auto", interpolation="nearest")
    axes.set_xticks(
        range(table.shape[1]), [str(name).replace("_", " ") for name in table], rotation=40, ha="right"
    )
    axes.set_yticks(range(len(order)), [f"{rig} *" if rig in told else str(rig) for rig in order])
    axes.grid(visible=False)


def discoveries(nights: pd.DataFrame, level: float) -> Figure:
    """Rigs reported by night, and the largest expected share of false alarms."""
    with rc_context(STYLE):
        figure = Figure(figsize=(9.2, 2.6), layout="constrained")
        axes = figure.subplots()
        count = nights.groupby("date")["told"].sum()
        x = np.arange(len(count))
        axes.plot(x, count.to_numpy(dtype=float), color=ALARM, drawstyle="steps-post", label="rigs reported")
        axes.plot(x, level * count.to_numpy(dtype=float), color=QUIET, label=f"{100 * level:g} % of them")
        _dates(axes, list(count.index))
        axes.legend(loc="upper left")
        return figure


def trend(measures: pd.DataFrame, quantity: str, unit: str, date: str, reference: int) -> Figure:
    """A quantity of a rig over its dates, with 95 % intervals of each, and the date of its report."""
    with rc_context(STYLE):
        figure = Figure(figsize=(9.2, 2.6), layout="constrained")
        axes = figure.subplots()
        tests = measures[measures["job"] == "test"]
        shown = (tests if len(tests) else measures).sort_values("date")
        dates = list(dict.fromkeys(shown["date"]))
        x = np.array([dates.index(one) for one in shown["date"]], dtype=float)
        y, sd = shown["value"].to_numpy(dtype=float), shown["sd"].to_numpy(dtype=float)
        for at, value, half in zip(x, y, 1.96 * np.nan_to_num(sd), strict=True):
            axes.plot([at, at], [value - half, value + half], color=QUIET, lw=0.8)
        axes.plot(x, y, "o", ms=4, color=WINDOW, label=axis_name(quantity, unit))
        first = y[np.isin(x, range(reference))]
        axes.axhline(float(np.mean(first)) if len(first) else 0.0, color=INK, lw=0.8, ls="--")
        if date in dates:
            axes.axvline(float(dates.index(date)), color=FREE, lw=1.0)
        _dates(axes, dates)
        axes.set_ylabel(axis_name(quantity, unit))
        return figure


def outcomes(axes: Axes, counts: Mapping[str, int]) -> None:
    """How many rows ended how."""
    axes.barh(list(counts), list(counts.values()), color=WINDOW)
    axes.set_xlabel("rows")


def _dates(axes: Axes, dates: Sequence[str]) -> None:
    every = max(1, len(dates) // 10)
    axes.set_xticks(range(0, len(dates), every), [str(one) for one in dates[::every]])
