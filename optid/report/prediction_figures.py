"""Figures of predictions and measurements over time, and of residuals over time, state and lag.

Tables are those of results: `prediction` with time (s), NAME, NAME_free_run and NAME_window (SI), of one recording.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from optid.core.model import Array
from optid.core.quantity import friendly
from optid.report.figures import ALARM, FREE, INK, QUIET, STYLE, WINDOW, axis_name, bounded
from optid.report.residuals import autocorrelation, residual

if TYPE_CHECKING:
    import pandas as pd

DOTS = 1500  # of residuals over a state
ABOVE: Any = {"loc": "lower left", "bbox_to_anchor": (0, 1.0), "borderaxespad": 0.2}


def overlay(
    frame: pd.DataFrame,
    inputs: pd.DataFrame,
    role: str,
    units: Mapping[str, str],
    horizon: float,
    sd: float | None = None,
) -> Figure:
    """Prediction and measurement, the error of the windows, and the inputs.

    Args:
        frame: of one recording.
        inputs: time (s), and each input as recorded.
        role: of the output.
        units: SI units of outputs and inputs by role.
        horizon: s, of a window.
        sd: of the noise, SI, where known.
    """
    roles = [str(name) for name in inputs if name not in ("recording", "time")]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 6.0), layout="constrained")
        top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(2.8, 1.4, 1.2))
        predictions(top, frame, role, units[role], horizon)
        factor, unit = friendly(units[role])
        time, error = _column(frame, "time"), factor * residual(frame, role, "window")
        if sd is not None and np.isfinite(sd):
            band = 2 * factor * sd
            middle.axhspan(-band, band, color=QUIET, alpha=0.3, lw=0, label="±2 sd of the noise")
            middle.legend(loc="lower right", bbox_to_anchor=(1, 1.0), borderaxespad=0.2)
        middle.plot(time, error, color=WINDOW, lw=0.8, label="_error of windows")
        middle.set_ylabel(axis_name("window error", unit))
        for name in roles:
            bottom.plot(_column(inputs, "time"), _column(inputs, name), color=QUIET, lw=0.9, label=f"_{name}")
        bottom.set_ylabel(axis_name(" and ".join(roles), units[roles[0]]) if roles else "")
        bottom.set_xlabel("time (s)")
        figure.align_ylabels()
        return figure


def predictions(axes: Axes, frame: pd.DataFrame, role: str, unit: str, horizon: float) -> None:
    """Free run, measurement and windows of one output on given axes, with their 95 % band where there is one."""
    factor, shown = friendly(unit)
    time = _column(frame, "time")
    for kind, colour in (("free_run", FREE), ("window", WINDOW)):
        if f"{role}_{kind}_low" in frame:
            low, high = (factor * _column(frame, f"{role}_{kind}_{end}") for end in ("low", "high"))
            words = "free run" if kind == "free_run" else "window"
            axes.fill_between(time, low, high, color=colour, alpha=0.2, lw=0, label=f"95 % of the {words}")
    for column, colour, label, width in (
        (f"{role}_free_run", FREE, "free run", 1.1),
        (role, INK, "measured", 1.7),
        (f"{role}_window", WINDOW, f"{horizon:g} s window", 1.0),
    ):
        axes.plot(time, factor * _column(frame, column), color=colour, lw=width, label=label)
    axes.set_ylim(*bounded(factor * _column(frame, role), factor * _column(frame, f"{role}_free_run")))
    axes.set_ylabel(axis_name(role, shown))
    axes.legend(ncols=5, **ABOVE)


def residuals(frame: pd.DataFrame, role: str, unit: str) -> Figure:
    """Window residuals over the output and its rate, and their autocorrelation.

    Args:
        frame: of one recording.
        role: of the output.
        unit: its SI unit.
    """
    factor, shown = friendly(unit)
    error = factor * residual(frame, role, "window")
    time, predicted = _column(frame, "time"), factor * _column(frame, f"{role}_window")
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 2.4), layout="constrained")
        axes: Any = figure.subplots(1, 3)
        _dots(axes[0], predicted, error, axis_name(role, shown))
        axes[0].set_ylabel(axis_name("window error", shown))
        _dots(axes[1], np.gradient(predicted, time), error, axis_name("its rate", f"{shown}/s"))
        axes[1].sharey(axes[0])
        _correlogram(axes[2], error, float(np.median(np.diff(time))))
        return figure


def nodes(frame: pd.DataFrame) -> Figure:
    """Defect and misfit at every node, one colour for the sound ones, one for the others."""
    names = list(dict.fromkeys(frame["recording"]))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 0.6 + 1.9 * len(names)), layout="constrained")
        axes = figure.subplots(len(names), 2, squeeze=False)
        for row, name in zip(axes, names, strict=True):
            part = frame[frame["recording"] == name]
            sound = np.asarray(part["sound"], dtype=bool)
            for axis, column in zip(row, ("defect", "misfit"), strict=True):
                values, at = _column(part, column), _column(part, "time")
                axis.scatter(at[sound], values[sound], s=5, color=WINDOW, lw=0)
                if not sound.all():
                    axis.scatter(at[~sound], values[~sound], s=9, color=ALARM, lw=0)
                axis.set_title(f"{column} · {name}", loc="left", fontsize=9, color="#4a525c")
                axis.set_xlabel("time (s)")
        return figure


def profile(axes: Axes, frame: pd.DataFrame, entry: Mapping[str, Any], name: str) -> None:
    """The deviance over a parameter's value, with the parabola of the fit's own interval.

    Args:
        axes: to draw on.
        frame: value (SI) and deviance.
        entry: value, unit, limit and fit_ci95 of the profile.
        name: of the parameter.
    """
    factor, unit = friendly(entry["unit"])
    low, high = entry["fit_ci95"]
    values, deviance, limit = _column(frame, "value"), _column(frame, "deviance"), entry["limit"]
    if low is not None and high is not None:
        span = np.linspace(values[0], values[-1], 200)
        bent = 4 * limit * ((span - entry["value"]) / (high - low)) ** 2
        axes.plot(factor * span, bent, color=QUIET, lw=0.9, label="the fit's own interval")
    axes.plot(factor * values, deviance, color=WINDOW, marker="o", ms=3.5, label="profile")
    axes.axhline(limit, color=ALARM, lw=0.8, ls=(0, (4, 3)), label="95 %")
    axes.set_ylim(-0.03 * limit, 1.1 * max(float(deviance.max()), limit))
    axes.set_xlabel(axis_name(name, unit))
    axes.set_ylabel("deviance")
    axes.legend(ncols=3, **ABOVE)


def _dots(axes: Any, x: Array, y: Array, name: str) -> None:
    both = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    some = both[:: max(len(both) // DOTS, 1)]
    axes.plot(x[some], y[some], ".", ms=2, color=INK, alpha=0.4)
    axes.set_xlabel(name)


def _correlogram(axes: Any, error: Array, interval: float) -> None:
    lags, values, band = autocorrelation(error)
    axes.axhspan(-band, band, color=QUIET, alpha=0.25, lw=0)
    axes.vlines(lags * interval * 1e3, 0, values, color=WINDOW, lw=0.9)
    most = min(1.05, 1.2 * float(np.max(np.abs(values), initial=2 * band)))
    axes.set_ylim(-most, most)
    axes.set_ylabel("autocorrelation")
    axes.set_xlabel("lag (ms)")


def _column(frame: pd.DataFrame, name: str) -> Array:
    return np.asarray(frame[name], dtype=np.float64)
