"""Figures as SVG text that a page can hold: no state of pyplot, no file on the way."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from optid.core.recording import Array, Recording
from optid.estimation.prediction import Prediction
from optid.estimation.profile import Profile
from optid.report.scores import friendly, residual

INK, WINDOW, FREE, QUIET, ALARM = "#2b2f36", "#0a7e8c", "#c8743a", "#9aa3ad", "#b3372f"
POINTS = 1800  # vertices a line keeps: more than the pixels of the page
LAGS = 200
STYLE: Any = {
    "font.family": "sans-serif", "font.size": 9, "axes.edgecolor": "#c9ced4", "axes.labelcolor": "#4a525c",
    "axes.spines.top": False, "axes.spines.right": False, "axes.linewidth": 0.8, "axes.grid": True,
    "grid.color": "#edf0f2", "grid.linewidth": 0.8, "xtick.color": "#6b747e", "ytick.color": "#6b747e",
    "lines.linewidth": 1.1, "legend.frameon": False, "svg.fonttype": "path", "svg.hashsalt": "optid",
    "axes.axisbelow": True,
}  # fmt: skip


def overlay(recording: Recording, prediction: Prediction, role: str, inputs: Sequence[str]) -> str:
    """Prediction over measurement, with the inputs that drove it underneath."""
    factor, unit = friendly(recording[role].unit)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 3.9), layout="constrained")
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(3.4, 1))
        frame = prediction.frame
        time = np.asarray(frame["time"], dtype=np.float64)
        for column, colour, label, width in (
            (f"{role}_free_run", FREE, "free run", 1.1),
            (role, INK, "measured", 1.7),
            (f"{role}_window", WINDOW, f"{prediction.horizon:g} s window", 1.0),
        ):
            top.plot(*thin(time, factor * np.asarray(frame[column], dtype=np.float64)), color=colour,
                     lw=width, label=label)  # fmt: skip
        _bounded(top, factor * recording[role].values, factor * np.asarray(frame[f"{role}_free_run"]))
        top.set_ylabel(axis_name(role, unit))
        top.legend(loc="lower left", ncols=3, bbox_to_anchor=(0, 1.0), borderaxespad=0.2)
        for name in inputs:
            channel = recording[name]
            bottom.plot(*thin(recording.time, channel.recorded), color=QUIET, lw=0.9)
            bottom.set_ylabel(axis_name(name, channel.recorded_unit))
        bottom.set_xlabel("time (s)")
        figure.align_ylabels()
        return svg(figure)


def residuals(recording: Recording, prediction: Prediction, role: str, sd: float | None) -> str:
    """Window residuals against time, and their autocorrelation with its 95 % band for white noise."""
    factor, unit = friendly(recording[role].unit)
    error = residual(prediction, role, "window")
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 2.5), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(2.1, 1))
        if sd is not None and np.isfinite(sd):
            left.axhspan(-2 * factor * sd, 2 * factor * sd, color=WINDOW, alpha=0.12, lw=0,
                         label="±2 sd of the noise")  # fmt: skip
            left.legend(loc="lower right", bbox_to_anchor=(1, 1.0), borderaxespad=0.2)
        left.plot(
            *thin(np.asarray(prediction.frame["time"], dtype=np.float64), factor * error),
            color=WINDOW,
            lw=0.8,
        )
        left.set_ylabel(axis_name("window residual", unit))
        left.set_xlabel("time (s)")
        lags, values, band = autocorrelation(error)
        right.axhspan(-band, band, color=QUIET, alpha=0.25, lw=0)
        right.vlines(lags * recording.interval * 1e3, 0, values, color=WINDOW, lw=0.9)
        right.set_ylim(-1.05, 1.05)
        right.set_ylabel("autocorrelation")
        right.set_xlabel("lag (ms)")
        return svg(figure)


def certificate(frame: Any) -> str:
    """Defect and misfit at every node, one colour for the sound ones, one for the others."""
    names = list(dict.fromkeys(frame["recording"]))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 0.6 + 1.9 * len(names)), layout="constrained")
        axes = figure.subplots(len(names), 2, squeeze=False)
        for row, name in zip(axes, names, strict=True):
            part = frame[frame["recording"] == name]
            sound = np.asarray(part["sound"], dtype=bool)
            for axis, column in zip(row, ("defect", "misfit"), strict=True):
                values = np.asarray(part[column], dtype=np.float64)
                at = np.asarray(part["time"], dtype=np.float64)
                axis.scatter(at[sound], values[sound], s=5, color=WINDOW, lw=0)
                axis.scatter(at[~sound], values[~sound], s=9, color=ALARM, lw=0)
                axis.set_title(f"{column} · {name}", loc="left", fontsize=9, color="#4a525c")
                axis.set_xlabel("time (s)")
        return svg(figure)


def profile(one: Profile) -> str:
    """How much worse every value of a parameter is, beside the parabola of the fit's own interval."""
    factor, unit = friendly(one.unit)
    low, high = one.linear
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 2.7), layout="constrained")
        axis = figure.subplots()
        span = np.linspace(one.values[0], one.values[-1], 200)
        bent = 4 * one.limit * ((span - one.value) / (high - low)) ** 2
        axis.plot(factor * span, bent, color=QUIET, lw=0.9, label="the fit's own interval")
        axis.plot(factor * one.values, one.deviance, color=WINDOW, marker="o", ms=3.5, label="profile")
        axis.axhline(one.limit, color=ALARM, lw=0.8, ls=(0, (4, 3)), label="95 %")
        axis.set_ylim(-0.03 * one.limit, 1.1 * max(float(one.deviance.max()), one.limit))
        axis.set_xlabel(axis_name(one.name, unit))
        axis.set_ylabel("deviance")
        axis.legend(loc="lower left", ncols=3, bbox_to_anchor=(0, 1.0), borderaxespad=0.2)
        return svg(figure)


def autocorrelation(error: Array) -> tuple[Array, Array, float]:
    """Lags (samples, from 1), autocorrelation there, and the 95 % band of white noise.

    Missing samples count as zero, which shrinks the values a little.
    """
    known = np.isfinite(error)
    if known.sum() < 3:
        return np.empty(0), np.empty(0), 1.0
    centred = np.where(known, error - error[known].mean(), 0.0)
    power = np.abs(np.fft.rfft(centred, 2 * len(centred))) ** 2
    products = np.fft.irfft(power)[: min(LAGS, len(centred) - 1) + 1]
    band = 1.96 / float(np.sqrt(known.sum()))
    if products[0] <= 0:
        return np.empty(0), np.empty(0), band
    return np.arange(1.0, len(products)), products[1:] / products[0], band


def thin(time: Array, values: Array) -> tuple[Array, Array]:
    """Lowest and highest value of every stretch, so that no spike is lost."""
    if len(values) <= POINTS:
        return time, values
    size = -(-len(values) // (POINTS // 2))
    pad = -len(values) % size
    rows = np.r_[values, np.full(pad, np.nan)].reshape(-1, size)
    known = np.isfinite(rows)
    low = np.argmin(np.where(known, rows, np.inf), axis=1)
    high = np.argmax(np.where(known, rows, -np.inf), axis=1)
    picked = np.sort(np.c_[low, high], axis=1) + size * np.arange(len(rows))[:, None]
    at = np.minimum(picked.ravel(), len(values) - 1)
    return time[at], values[at]


def _bounded(axis: Any, measured: Array, predicted: Array) -> None:
    """Keep the measurement readable when a free run runs away."""
    known = measured[np.isfinite(measured)]
    low, high = float(known.min()), float(known.max())
    span = (high - low) or 1.0
    there = predicted[np.isfinite(predicted)]
    if there.size:
        low, high = (
            max(float(min(there.min(), low)), low - span),
            min(float(max(there.max(), high)), high + span),
        )
    axis.set_ylim(low - 0.05 * span, high + 0.05 * span)


def axis_name(name: str, unit: str) -> str:
    """A quantity and its unit, as an axis shows them."""
    plain = name.replace("_", " ")
    return f"{plain} ({unit})" if unit and unit != "1" else plain


def svg(figure: Figure) -> str:
    """A figure as text for a page."""
    buffer = io.BytesIO()
    FigureCanvasSVG(figure)
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue().decode("utf-8")
    return text[text.index("<svg") :]
