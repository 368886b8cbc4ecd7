"""What all figures share: colours, style, names of axes, and the autocorrelation that several of them show."""

from __future__ import annotations

from typing import Any

import numpy as np

from optid.core.model import Array
from optid.report.residuals import LAGS, autocorrelation
from optid.report.vertices import thin
from optid.results.picture import svg

__all__ = [
    "ALARM",
    "FREE",
    "INK",
    "LAGS",
    "QUIET",
    "STYLE",
    "WINDOW",
    "autocorrelation",
    "axis_name",
    "bounded",
    "svg",
    "thin",
]

# figures.js has their counterparts for a dark page.
INK, WINDOW, FREE, QUIET, ALARM = "#2b2f36", "#0a7e8c", "#c8743a", "#9aa3ad", "#b3372f"
STYLE: Any = {
    "font.family": "sans-serif",
    "font.size": 9,
    "axes.edgecolor": "#c9ced4",
    "axes.labelcolor": "#4a525c",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "grid.color": "#edf0f2",
    "grid.linewidth": 0.8,
    "xtick.color": "#6b747e",
    "ytick.color": "#6b747e",
    "lines.linewidth": 1.1,
    "legend.frameon": False,
    "svg.fonttype": "path",
    "svg.hashsalt": "optid",
    "axes.axisbelow": True,
}


def bounded(measured: Array, predicted: Array) -> tuple[float, float]:
    """Limits of an axis that keep the measurement readable when a prediction diverges."""
    known = measured[np.isfinite(measured)]
    if not known.size:
        return -1.0, 1.0
    low, high = float(known.min()), float(known.max())
    span = (high - low) or 1.0
    there = predicted[np.isfinite(predicted)]
    if there.size:
        low = max(float(min(there.min(), low)), low - span)
        high = min(float(max(there.max(), high)), high + span)
    return low - 0.05 * span, high + 0.05 * span


def axis_name(name: str, unit: str) -> str:
    """A quantity and its unit, as the label of an axis."""
    plain = name.replace("_", " ")
    return f"{plain} ({unit})" if unit and unit != "1" else plain
