"""The page's figures as SVG text."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

INK, ACCENT, WARM, QUIET, ALARM = "#2b2f36", "#0a7e8c", "#c8743a", "#9aa3ad", "#b3372f"
STYLE: Any = {
    "font.family": "sans-serif",
    "font.size": 8.5,
    "axes.edgecolor": "#c9ced4",
    "axes.labelcolor": "#4a525c",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "axes.axisbelow": True,
    "xtick.color": "#6b747e",
    "ytick.color": INK,
    "legend.frameon": False,
    "svg.fonttype": "path",
    "svg.hashsalt": "trial",
}


def _svg(figure: Figure) -> str:
    FigureCanvasSVG(figure)
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata={"Date": None})
    return text.getvalue().partition("<!DOCTYPE")[2].partition(">")[2]


def rates(rows: Sequence[Mapping[str, Any]]) -> str:
    """Each rate with its interval, and a tick where it should be."""
    shown = [r for r in rows if r["trials"]][::-1]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 0.5 + 0.27 * len(shown)), layout="constrained")
        axes = figure.subplots()
        for y, r in enumerate(shown):
            low, high = r["interval"]
            met = r["target"] is None or r["share"] >= r["target"]
            axes.plot([100 * low, 100 * high], [y, y], color="#d5dade", lw=5, solid_capstyle="round")
            axes.plot(100 * r["share"], y, "o", ms=6, color=ACCENT if met else ALARM)
            if r["target"] is not None:
                axes.plot([100 * r["target"]] * 2, [y - 0.36, y + 0.36], color=INK, lw=1.4)
        axes.set_yticks(range(len(shown)), [r["figure"] for r in shown])
        axes.tick_params(axis="y", length=0)
        axes.set_xlim(-2, 102)
        axes.set_xlabel("%")
        axes.grid(axis="x", color="#edf0f2")
        return _svg(figure)


def gains(cases: Sequence[Mapping[str, Any]]) -> str:
    """Hold-out RMSE over the oracle's, after against before."""
    groups = {
        "named exactly": (ACCENT, [c for c in cases if c["exact"] and c["true"]]),
        "otherwise": (WARM, [c for c in cases if not c["exact"] and c["true"]]),
        "nothing missing": (QUIET, [c for c in cases if not c["true"]]),
    }
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.4, 4.2), layout="constrained")
        axes = figure.subplots()
        top = 2.0
        for label, (colour, some) in groups.items():
            points = [
                (c["before"] / c["oracle"], c["after"] / c["oracle"])
                for c in some
                if c["before"] and c["after"] and c["oracle"]
            ]
            if points:
                before, after = np.array(points).T
                axes.plot(before, after, "o", ms=5, alpha=0.75, color=colour, mec="none", label=label)
                top = max(top, float(before.max()), float(after.max()))
        axes.plot([0.7, 1.5 * top], [0.7, 1.5 * top], color="#c9ced4", lw=1)
        axes.axhline(1.0, color=INK, lw=0.8)
        axes.set(
            xscale="log", yscale="log", xlabel="before, over the oracle's", ylabel="after, over the oracle's"
        )
        axes.grid(color="#edf0f2")
        axes.legend(loc="upper left")
        return _svg(figure)


def confusion(table: Mapping[str, Mapping[str, int]]) -> str:
    """Rows: what is there; columns: what is said first."""
    rows = list(table)
    columns = sorted({name for said in table.values() for name in said}, key=lambda n: (n not in rows, n))
    counts = np.array([[table[row].get(column, 0) for column in columns] for row in rows], dtype=float)
    right = np.array(
        [
            [
                row.removesuffix(" (outside)") == c or ("(outside)" in row and c == "unexplained")
                for c in columns
            ]
            for row in rows
        ]
    )
    with mpl.rc_context({**STYLE, "axes.spines.left": False, "axes.spines.bottom": False}):
        figure = Figure(figsize=(9.2, 1.9 + 0.21 * len(rows)), layout="constrained")
        axes = figure.subplots()
        for i, row in enumerate(counts):
            total = row.sum()
            axes.axhline(i, color="#f1f3f5", lw=0.8)
            for j, n in enumerate(row):
                if n:
                    colour = ACCENT if right[i, j] else ALARM
                    axes.plot(j, i, "s", ms=4 + 8 * (n / total) ** 0.5, color=colour, alpha=0.85, mec="none")
                    axes.annotate(f"{n:.0f}", (j, i), color="white", ha="center", va="center", fontsize=6.5)
        axes.set_xticks(range(len(columns)), [c.replace("_", " ") for c in columns], rotation=60, ha="left")
        axes.set_yticks(range(len(rows)), [r.replace("_", " ") for r in rows])
        axes.xaxis.tick_top()
        axes.tick_params(length=0)
        axes.set_ylim(len(rows) - 0.4, -0.6)
        axes.set_xlim(-0.6, len(columns) - 0.4)
        return _svg(figure)


def matrix(rows: Mapping[str, Mapping[str, float | None]]) -> str:
    """Smallest separable sizes, logarithmic; rows and columns that a recording does not show stay white."""
    names = [name for name in rows if rows[name]["alone"] is not None]
    values = np.array(
        [[np.nan if a == b else rows[a][b] or np.nan for b in names] for a in names], dtype=float
    )
    with mpl.rc_context({**STYLE, "axes.spines.left": False, "axes.spines.bottom": False}):
        figure = Figure(figsize=(9.2, 7.6), layout="constrained")
        axes = figure.subplots()
        image = axes.imshow(np.log10(values), cmap="YlGnBu_r", vmin=-3, vmax=0.5)
        axes.set_xticks(range(len(names)), [n.replace("_", " ") for n in names], rotation=60, ha="left")
        axes.set_yticks(range(len(names)), [n.replace("_", " ") for n in names])
        axes.xaxis.tick_top()
        axes.tick_params(length=0)
        bar = figure.colorbar(image, ax=axes, shrink=0.5, ticks=[-3, -2, -1, 0])
        bar.ax.set_yticklabels(["0.001", "0.01", "0.1", "1"])
        bar.set_label("smallest separable size / medium size")
        return _svg(figure)


def story(
    recording: pd.DataFrame, true: Sequence[Sequence[float]], flagged: Sequence[Sequence[float]]
) -> str:
    """Position and reference of a recording, with the times at which the effect acts and those flagged."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 2.9), layout="constrained")
        axes, bands = figure.subplots(2, 1, sharex=True, height_ratios=(4, 1))
        axes.plot(recording["t"], recording["r"], color=QUIET, lw=1, label="reference")
        axes.plot(recording["t"], recording["x"], color=INK, lw=1.2, label="position")
        axes.set_ylabel("mm")
        axes.legend(loc="upper right", ncols=2)
        for y, (spans, colour) in enumerate(((flagged, ACCENT), (true, QUIET))):
            bands.broken_barh([(a, b - a) for a, b in spans], (y - 0.35, 0.7), color=colour, lw=0)
        bands.set_yticks([0, 1], ["flagged", "acts"])
        bands.tick_params(axis="y", length=0)
        bands.set_ylim(-0.5, 1.5)
        bands.set_xlabel("s")
        return _svg(figure)
