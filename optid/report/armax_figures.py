"""Figures of the ARMAX report: multi-step predictions, the recursion's path, residual correlations."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from optid.armax.offline import Identification, names
from optid.armax.table2 import Table2
from optid.core.recording import Array
from optid.report.figures import ALARM, FREE, INK, LAGS, QUIET, STYLE, WINDOW, axis_name, thin
from optid.report.interactive import interactive

COLOURS = (WINDOW, FREE, ALARM, "#6a4c93", "#4c8c4a", QUIET)
CLOSE = 160  # samples of the close view


def responses(table: Table2, time: Array, group: Sequence[tuple[int, int]], name: str) -> str:
    """Measured and predicted output around the largest error, and all errors over the whole recording.

    Args:
        table: in the unit of the figure.
        time: s, shape (N,).
        group: pairs of order and steps.
        name: of the output.
    """
    first, last = hardest(table.traces[group[-1]] - table.real)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 2.8 + 0.95 * len(group)), layout="constrained")
        axes = figure.subplots(1 + len(group), 1, height_ratios=(2.8, *[1.0] * len(group)))
        close = axes[0]
        close.plot(time[first:last], table.real[first:last], color=INK, lw=1.9, label="measured")
        for (order, steps), colour in zip(group, COLOURS, strict=False):
            guess = table.traces[order, steps][first:last]
            close.plot(time[first:last], guess, color=colour, lw=1.0, label=said(order, steps))
        close.set_ylabel(axis_name(name, table.unit))
        close.legend(loc="lower left", ncols=4, bbox_to_anchor=(0, 1.0), borderaxespad=0.2)
        for axis, (order, steps), colour in zip(axes[1:], group, COLOURS, strict=False):
            axis.plot(*thin(time, table.traces[order, steps] - table.real), color=colour, lw=0.7)
            axis.axvspan(time[first], time[last - 1], color=QUIET, alpha=0.15, lw=0)
            axis.set_ylabel(axis_name("error", table.unit))
            axis.set_title(said(order, steps), loc="left", fontsize=8, color="#4a525c", pad=2)
            axis.tick_params(labelbottom=axis is axes[-1])
        axes[-1].set_xlabel("time (s)")
        figure.align_ylabels()
        return interactive(figure)


def said(order: int, steps: int) -> str:
    """An experiment of Table 2 in words."""
    return f"order {order}, {steps} step{'s' if steps > 1 else ''}"


def hardest(error: Array) -> tuple[int, int]:
    """The stretch of at most `CLOSE` samples centred at the largest error."""
    worst = int(np.argmax(np.abs(np.nan_to_num(error))))
    first = min(max(worst - CLOSE // 2, 0), max(error.size - CLOSE, 0))
    return first, min(first + CLOSE, error.size)


def path(taught: Identification, start: float) -> str:
    """The path of the recursion's coefficients of A, B and C along the recording.

    Args:
        taught: the recursion with its stored path.
        start: time of the first sample, s.
    """
    labels, model = names(taught.model.orders), taught.model
    time = start + (np.arange(len(taught.track)) + 1) * taught.every * model.sample_time
    letters = [letter for letter in "abc" if any(label.startswith(letter) for label in labels)]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 2.6), layout="constrained")
        for axis, letter in zip(figure.subplots(1, len(letters), squeeze=False)[0], letters, strict=True):
            for i, label in enumerate(labels):
                if label.startswith(letter):
                    axis.plot(time, taught.track[:, i], lw=1.0, label=label)
            axis.legend(
                loc="lower left",
                ncols=6,
                bbox_to_anchor=(-0.02, 1.06),
                borderaxespad=0.2,
                fontsize=7,
                columnspacing=0.7,
                handlelength=0.8,
                handletextpad=0.4,
            )
            axis.set_xlabel("time (s)")
        return interactive(figure)


def correlations(e: Array, u: Array, sample_time: float, input_names: Sequence[str]) -> str:
    """Correlation of the residuals with their own past and with each input's.

    Args:
        e: residuals, shape (N,), NaN where there are none.
        u: inputs, shape (N, m).
        sample_time: s.
        input_names: of the inputs.
    """
    panels = [("own past", e), *((name, column) for name, column in zip(input_names, u.T, strict=True))]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 2.2), layout="constrained")
        for axis, (name, suspect) in zip(
            figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True
        ):
            lags, values, band = correlation(e, suspect)
            axis.axhspan(-band, band, color=QUIET, alpha=0.25, lw=0)
            axis.vlines(lags * sample_time * 1e3, 0, values, color=WINDOW, lw=0.9)
            largest = float(np.max(np.abs(values), initial=band))
            axis.set_ylim(-1.2 * largest, 1.2 * largest)
            axis.set_title(f"residuals and {name.replace('_', ' ')}", loc="left", fontsize=9, color="#4a525c")
            axis.set_xlabel("lag (ms)")
        return interactive(figure)


def correlation(e: Array, suspect: Array) -> tuple[Array, Array, float]:
    """Lags from 1, correlation of e(t) with suspect(t - lag), and the 95 % band of unrelated signals."""
    known = np.isfinite(e)
    N = int(known.sum())
    x, w = (np.where(np.isfinite(s), s - np.nanmean(s), 0.0) for s in (np.where(known, e, np.nan), suspect))
    size = float(np.sqrt(np.sum(x**2) * np.sum(w**2)))
    lags = np.arange(1, min(LAGS, x.size // 4) + 1)
    if size == 0.0 or not lags.size:
        return np.empty(0), np.empty(0), 1.0
    cross = np.fft.irfft(np.fft.rfft(x, 2 * x.size) * np.conj(np.fft.rfft(w, 2 * x.size)))
    return lags.astype(float), cross[lags] / size, 1.96 / float(np.sqrt(N))
