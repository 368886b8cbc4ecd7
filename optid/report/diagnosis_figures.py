"""Figures of a diagnosis: before and after on the hold-out, the mismatch over time and over state."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from optid.core.model import Array
from optid.diagnosis.evaluation import Evaluation
from optid.diagnosis.result import Diagnosis, Finding
from optid.report.figures import ALARM, FREE, INK, QUIET, STYLE, WINDOW, svg, thin
from optid.report.scores import friendly

BINS = 60
DOTS = 4000  # points of a scatter plot


def before_after(d: Diagnosis, output: int) -> str:
    """Windows' residuals of the model as it came and of the improved one, with the noise's band."""
    port = d.base.rig.model.outputs[output]
    factor, unit = friendly(port.unit)
    sd = d.noise.get(port.role, float("nan"))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 2.9), layout="constrained")
        axes: Any = figure.subplots()
        for judged, colour, label in ((d.test.base, FREE, "before"), (d.test.best, WINDOW, "after")):
            if label == "after" and d.best is d.base:
                continue
            error = factor * (judged.measured[:, output] - judged.windows[:, output])
            axes.plot(_clock(judged), error, color=colour, lw=0.9, label=label)
        axes.axhspan(
            -2 * factor * sd, 2 * factor * sd, color=QUIET, alpha=0.3, lw=0, label="±2 sd of the noise"
        )
        _breaks(axes, d.test.base)
        axes.set_ylabel(f"error of {d.test.base.horizon:g} s windows ({unit})")
        axes.set_xlabel("time over the held-out recordings (s)")
        axes.legend(loc="lower left", ncols=3, bbox_to_anchor=(0, 1.0), borderaxespad=0.2)
        return svg(figure)


def mismatch_map(finding: Finding, names: tuple[str, ...]) -> str:
    """Where in time the mismatch is, one strip a recording."""
    region = finding.region
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 0.55 + 0.5 * len(names)), layout="constrained")
        axes: Any = figure.subplots(len(names), 1, squeeze=False, sharex=True)[:, 0]
        strips = []
        for number in range(len(names)):
            mine = region.owner == number
            slot = np.floor((region.time[mine] - region.time[mine][0]) / region.slot).astype(int)
            strips.append(np.sqrt(np.bincount(slot, weights=region.energy[mine])))
        top = max(float(s.max()) for s in strips)
        for axis, strip, name in zip(axes, strips, names, strict=True):
            axis.imshow(
                strip[None], aspect="auto", extent=(0, len(strip) * region.slot, 0, 1), cmap="YlOrRd", vmin=0,
                vmax=top or 1.0, interpolation="nearest",
            )  # fmt: skip
            axis.set_yticks([])
            axis.grid(False)
            axis.set_ylabel(name, rotation=0, ha="right", va="center")
        axes[-1].set_xlabel("time (s)")
        return svg(figure)


def over_state(finding: Finding, signal: str) -> str:
    """Density of the mismatch over a signal, beside the density of the samples."""
    region = finding.region
    values, unit = region.signals[signal]
    factor, shown = friendly(unit)
    good = np.isfinite(values)
    low, high = np.quantile(values[good], [0.002, 0.998])
    if high <= low:
        low, high = low - 1.0, high + 1.0
    edges = np.linspace(low, high, BINS + 1)
    v, e = values[good], region.energy[good]
    mismatch, _ = np.histogram(v, edges, weights=e)
    samples, _ = np.histogram(v, edges)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(4.5, 2.5), layout="constrained")
        axes: Any = figure.subplots()
        axes.stairs(
            samples / max(samples.sum(), 1),
            factor * edges,
            color=QUIET,
            fill=True,
            alpha=0.45,
            label="samples",
        )
        axes.stairs(
            mismatch / max(mismatch.sum(), 1e-300), factor * edges, color=ALARM, lw=1.4, label="mismatch"
        )
        axes.set_xlabel(f"{signal.replace('_', ' ')} ({shown})" if shown else signal.replace("_", " "))
        axes.set_ylabel("share")
        axes.legend(loc="lower left", ncols=2, bbox_to_anchor=(0, 1.0), borderaxespad=0.2)
        return svg(figure)


def missing_signal(finding: Finding, names: tuple[str, ...]) -> str:
    """The unknown signal at a site as estimated with the states, the named law through it, and its likely cause."""
    assert finding.signal is not None
    region, w, law = finding.region, finding.signal.signal, finding.law
    what = "what describes it" if finding.effect is None else "named law"
    cause = next((name for name in finding.shown if name in region.signals), None)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 2.8), layout="constrained")
        axes: Any = figure.subplots(
            1, 1 if cause is None else 2, squeeze=False, width_ratios=(1,) if cause is None else (2.2, 1)
        )[0]
        start = 0.0
        for number in range(len(names)):
            mine = region.owner == number
            time = region.time[mine] - region.time[mine][0] + start
            axes[0].plot(*thin(time, w[mine]), color=INK, lw=0.9, label=None if number else "unknown signal")
            if law is not None:
                axes[0].plot(*thin(time, law[mine]), color=WINDOW, lw=1.0, label=None if number else what)
            start = float(time[-1])
            axes[0].axvline(start, color=QUIET, lw=0.6)
        bounds = _range(w, law)
        axes[0].set_ylim(*bounds)
        axes[0].set_ylabel(f"signal at {finding.signal.site}, SI")
        axes[0].set_xlabel(f"time over {', '.join(names)} (s)")
        axes[0].legend(loc="lower left", ncols=2, bbox_to_anchor=(0, 1.0), borderaxespad=0.2)
        if cause is not None:
            values, unit = region.signals[cause]
            factor, shown = friendly(unit)
            some = slice(None, None, max(len(w) // DOTS, 1))
            axes[1].plot(factor * values[some], w[some], ".", ms=1.5, color=INK, alpha=0.4)
            if law is not None:
                axes[1].plot(factor * values[some], law[some], ".", ms=1.5, color=WINDOW)
            axes[1].set_ylim(*bounds)
            axes[1].set_xlabel(f"{cause.replace('_', ' ')} ({shown})" if shown else cause.replace("_", " "))
        return svg(figure)


def _range(w: Array, law: Array | None) -> tuple[float, float]:
    """Nearly all of both: where nothing moves the unknown signal wanders."""
    both = w if law is None else np.concatenate([w, law])
    low, high = np.quantile(both[np.isfinite(both)], [0.01, 0.99])
    room = 0.15 * (high - low) or 1.0
    return float(low - room), float(high + room)


def _clock(judged: Evaluation) -> Array:
    """Time over all recordings, one after the other."""
    offset, clock = 0.0, np.empty_like(judged.time)
    for number in np.unique(judged.recording):
        mine = judged.recording == number
        clock[mine] = judged.time[mine] - judged.time[mine][0] + offset
        offset = float(clock[mine][-1])
    return clock


def _breaks(axes: Any, judged: Evaluation) -> None:
    clock = _clock(judged)
    for at in np.flatnonzero(np.diff(judged.recording)):
        axes.axvline(clock[at], color=QUIET, lw=0.6)
