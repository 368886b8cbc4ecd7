"""Figures of a diagnosis: before and after on held-out recordings, where the mismatch is, and the missing signal.

Tables are those of `optid.results.diagnosis.DiagnosisResult`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from optid.core.model import Array
from optid.core.quantity import friendly
from optid.report.figures import ALARM, FREE, INK, QUIET, STYLE, WINDOW, axis_name, bounded
from optid.report.prediction_figures import ABOVE

if TYPE_CHECKING:
    import pandas as pd

DOTS = 3000  # points of a scatter plot
NORMAL_95 = 1.96  # standard deviations: half a normal 95 % interval


def before_after(frame: pd.DataFrame, role: str, unit: str, noise: float | None, changed: bool) -> Figure:
    """Trajectories of both models with the measurement, above their errors.

    Args:
        frame: of the recordings held out.
        role: of the output.
        unit: its SI unit.
        noise: sd, SI, where known.
        changed: whether the improved model differs from the original.
    """
    factor, shown = friendly(unit)
    clock, breaks = _clock(frame)
    lines: list[tuple[str, str, float, str]] = [("before", FREE, 1.1, "_before"), ("measured", INK, 1.7, "")]
    lines += [("after", WINDOW, 1.0, "_after")] if changed else []
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 4.8), layout="constrained")
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1.2))
        for label, colour, width, suffix in lines:
            top.plot(clock, factor * _column(frame, f"{role}{suffix}"), color=colour, lw=width, label=label)
        top.set_ylim(*bounded(factor * _column(frame, role), factor * _column(frame, f"{role}_before")))
        top.set_ylabel(axis_name(role, shown))
        top.legend(ncols=3, **ABOVE)
        errors(bottom, frame, role, unit, noise, changed)
        for at in breaks:
            top.axvline(at, color=QUIET, lw=0.6)
        bottom.set_xlabel("time over the recordings held out (s)")
        figure.align_ylabels()
        return figure


def errors(
    axes: Any, frame: pd.DataFrame, role: str, unit: str, noise: float | None, changed: bool = True
) -> None:
    """Window errors of both models with the noise's band, on given axes."""
    factor, shown = friendly(unit)
    clock, breaks = _clock(frame)
    if noise is not None:
        band = 2 * factor * noise
        axes.axhspan(-band, band, color=QUIET, alpha=0.3, lw=0, label="±2 sd of the noise")
    for label, colour in (("before", FREE), ("after", WINDOW))[: 2 if changed else 1]:
        error = factor * (_column(frame, role) - _column(frame, f"{role}_{label}"))
        axes.plot(clock, error, color=colour, lw=0.9, label=label)
    for at in breaks:
        axes.axvline(at, color=QUIET, lw=0.6)
    axes.set_ylabel(axis_name("window error", shown))
    axes.legend(ncols=3, **ABOVE)


def mismatch_map(frame: pd.DataFrame) -> Figure:
    """The size of the mismatch over time, one strip per recording."""
    names = list(dict.fromkeys(frame["recording"]))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 0.7 + 0.9 * len(names)), layout="constrained")
        axes: Any = figure.subplots(len(names), 1, squeeze=False, sharex=True, sharey=True)[:, 0]
        for axis, name in zip(axes, names, strict=True):
            part = frame[frame["recording"] == name]
            time, size = _column(part, "time"), _column(part, "mismatch")
            axis.fill_between(time, 0.0, size, step="post", color=ALARM, alpha=0.35, lw=0)
            axis.plot(time, size, color=ALARM, lw=0.8, drawstyle="steps-post")
            axis.set_title(str(name), loc="left", fontsize=9, color="#4a525c")
        axes[-1].set_xlabel("time (s)")
        axes[len(names) // 2].set_ylabel("mismatch (sd)")
        return figure


def over_state(frame: pd.DataFrame, name: str, unit: str) -> Figure:
    """Share of the mismatch over a signal, compared with the share of the samples."""
    factor, shown = friendly(unit)
    edges = factor * np.append(_column(frame, "low"), _column(frame, "high")[-1])
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(4.5, 2.5), layout="constrained")
        axes: Any = figure.subplots()
        axes.stairs(_column(frame, "samples"), edges, color=QUIET, fill=True, alpha=0.45, label="samples")
        axes.stairs(_column(frame, "mismatch"), edges, color=ALARM, lw=1.4, label="mismatch")
        axes.set_xlabel(axis_name(name, shown))
        axes.set_ylabel("share")
        axes.legend(ncols=2, **ABOVE)
        return figure


def missing_signal(
    frame: pd.DataFrame, place: str, unit: str, cause: str | None, states: Mapping[str, Mapping[str, Any]]
) -> Figure:
    """The missing signal as estimated with the states, with its interval, the identified law, and its likely cause.

    Args:
        frame: recording, time, missing, and where they exist missing_sd, law and cause; SI.
        place: the plant's name of the site.
        unit: SI unit of the signal there; "" if unknown.
        cause: name of the signal in `cause`.
        states: signal -> its range, with the SI unit.
    """
    factor, shown = friendly(unit) if unit else (1.0, "SI unit of the signal")
    missing = factor * _column(frame, "missing")
    law = factor * _column(frame, "law") if "law" in frame else None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 2.8), layout="constrained")
        wide = "cause" in frame and cause is not None
        axes: Any = figure.subplots(
            1, 2 if wide else 1, squeeze=False, width_ratios=(2.2, 1) if wide else (1,)
        )[0]
        _missing_over_time(axes[0], frame, factor, missing, law)
        axes[0].set_ylabel(axis_name(f"missing at {place}", shown))
        if wide:
            assert cause is not None
            by, name = friendly(states[cause]["unit"])
            values, some = by * _column(frame, "cause"), slice(None, None, max(len(missing) // DOTS, 1))
            axes[1].plot(values[some], missing[some], ".", ms=2, color=INK, alpha=0.4)
            if law is not None:
                axes[1].plot(values[some], law[some], ".", ms=2, color=WINDOW)
            axes[1].set_ylim(*axes[0].get_ylim())
            axes[1].set_xlabel(axis_name(cause, name))
        return figure


def _missing_over_time(
    axes: Any, frame: pd.DataFrame, factor: float, missing: Array, law: Array | None
) -> None:
    """The unknown signal in the axis's unit, with its interval, and the law through it."""
    clock, breaks = _clock(frame)
    if "missing_sd" in frame:
        half = factor * NORMAL_95 * _column(frame, "missing_sd")
        axes.fill_between(
            clock, missing - half, missing + half, color=INK, alpha=0.2, lw=0, label="95 % of it"
        )
    axes.plot(clock, missing, color=INK, lw=0.9, label="estimated without a law")
    if law is not None:
        axes.plot(clock, law, color=WINDOW, lw=1.0, label="the identified law")
    for at in breaks:
        axes.axvline(at, color=QUIET, lw=0.6)
    axes.set_ylim(*_range(missing, law))
    axes.set_xlabel("time over the recordings fitted to (s)")
    axes.legend(ncols=3, **ABOVE)


def _range(missing: Array, law: Array | None) -> tuple[float, float]:
    """A range with nearly all of both: where nothing moves, the unknown signal drifts."""
    both = missing if law is None else np.concatenate([missing, law])
    known = both[np.isfinite(both)]
    low, high = np.quantile(known, [0.01, 0.99]) if known.size else (-1.0, 1.0)
    room = 0.15 * (high - low) or 1.0
    return float(low - room), float(high + room)


def _clock(frame: pd.DataFrame) -> tuple[Array, list[float]]:
    """Time over all recordings, one after the other, and where one ends and the next begins."""
    offset, clock, breaks = 0.0, np.empty(len(frame)), []
    names = np.asarray(frame["recording"], dtype=str)
    time = _column(frame, "time")
    for name in dict.fromkeys(names.tolist()):
        mine = names == name
        clock[mine] = time[mine] - time[mine][0] + offset
        offset = float(clock[mine][-1])
        breaks.append(offset)
    return clock, breaks[:-1]


def _column(frame: pd.DataFrame, name: str) -> Array:
    return np.asarray(frame[name], dtype=np.float64)
