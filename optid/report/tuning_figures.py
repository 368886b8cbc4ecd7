"""Figures of a tuning: responses with commands, the loop's frequency response, the cost around the optimum."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from optid.core.model import Array
from optid.core.quantity import friendly
from optid.report.figures import ALARM, FREE, INK, QUIET, STYLE, WINDOW, axis_name
from optid.report.interactive import interactive
from optid.tuning.bench_search import few_episodes
from optid.tuning.margins import Frequencies, loop_response
from optid.tuning.response_metrics import Response, by_size
from optid.tuning.search import PLACES, SIGNED
from optid.tuning.task import REFUSED, Task
from optid.tuning.tuning import Scored, Tuning

REST = ("#6f8fc9", "#b9a44c", "#8e6bb0")  # baselines
# Of a landscape, on each side: linear, with friction, on a rig's physical model.
CELLS, MIDDLE, COARSE = 41, 21, 11
WORTH = 1.0  # decades above the best cost that a landscape shows


def responses(
    tuning: Tuning, shown: Sequence[Scored], episode: int, units: tuple[str, str], bench: bool
) -> str:
    """Output over reference, and the command under it with its limits.

    Args:
        tuning: its gains come first.
        shown: baselines beside them.
        episode: number of it.
        units: of output and command, SI.
        bench: show the runs on the physical model instead of those on the identified one.
    """
    factor, unit = friendly(units[0])
    time: Array = tuning.settings.sample_time * np.arange(float(tuning.task.episodes[episode].reference.size))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 4.3), layout="constrained")
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1.4))
        top.step(
            time,
            factor * tuning.task.episodes[episode].reference,
            where="post",
            color=QUIET,
            lw=1.0,
            ls=(0, (4, 3)),
        )
        lines = [*zip(shown, REST, strict=False), (tuning.found, WINDOW)]
        for one, colour in lines:
            runs = one.bench if bench else one.responses
            run, own = runs[episode], one is tuning.found
            label = f"{one.name.replace('_', ' ')}: {run.measures['itae']:.3g}"
            top.plot(time, factor * run.output, color=colour, lw=1.7 if own else 1.0, label=label)
            bottom.step(time, run.command, where="post", color=colour, lw=1.1 if own else 0.7)
        limits = [v for v in (tuning.settings.low, tuning.settings.high) if math.isfinite(v)]
        for value in limits:
            bottom.axhline(value, color=ALARM, lw=0.8, ls=(0, (4, 3)))
        _window(top, factor, tuning, episode, bench)
        top.set_xlim(0.0, _interesting(tuning, episode, bench, time))
        top.set_ylabel(axis_name("output", unit))
        bottom.set_ylabel(axis_name("command", units[1]))
        bottom.set_xlabel("time (s)")
        top.legend(loc="lower left", ncols=4, bbox_to_anchor=(0, 1.0), borderaxespad=0.2)
        figure.align_ylabels()
        return interactive(figure)


def _window(axis: Any, factor: float, tuning: Tuning, episode: int, bench: bool) -> None:
    """Keep the tuned response readable beside an unstable one."""
    run = (tuning.found.bench if bench else tuning.found.responses)[episode]
    values = factor * np.r_[run.output[np.isfinite(run.output)], run.episode.reference]
    low, high = float(values.min()), float(values.max())
    room = 0.35 * ((high - low) or 1.0)
    axis.set_ylim(low - 0.4 * room, high + room)


def _interesting(tuning: Tuning, episode: int, bench: bool, time: Array) -> float:
    """A step is shown up to four times the settling time of the tuned loop, everything else in full."""
    run: Response = (tuning.found.bench if bench else tuning.found.responses)[episode]
    moves = np.flatnonzero(np.diff(run.episode.reference, prepend=0.0))
    if moves.size == 1 and math.isfinite(run.settled):
        return float(min(time[-1], time[moves[0]] + max(4.0 * run.settled, 0.1 * time[-1])))
    return float(time[-1])


def loop(tuning: Tuning) -> str:
    """Nyquist curve around the critical point, and the sensitivity over frequency."""
    plant, gains = tuning.task.loops[0], tuning.gains.vector
    grid = Frequencies.of(plant, 3000).at
    L = loop_response(plant, gains, grid)
    margins = tuning.found.margins
    assert margins is not None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 3.4), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(1, 1.5))
        left.plot(L.real, L.imag, color=WINDOW)
        turn = np.linspace(0.0, 2.0 * math.pi, 200)
        left.plot(np.cos(turn), np.sin(turn), color=QUIET, lw=0.8)
        radius = 1.0 / margins.maximum_sensitivity  # 0 where the linear loop is unstable: no circle
        left.plot(-1 + radius * np.cos(turn), radius * np.sin(turn), color=ALARM, lw=0.9, ls=(0, (4, 3)))
        left.plot([-1], [0], marker="+", color=ALARM, ms=8)
        left.set_xlim(-2.6, 1.2)
        left.set_ylim(-1.9, 1.9)
        left.set_aspect("equal")
        left.set_xlabel("real part of L")
        left.set_ylabel("imaginary part")
        hertz = grid / (2.0 * math.pi * plant.sample_time)
        S = 1.0 / (1.0 + L)
        right.loglog(hertz, np.abs(S), color=WINDOW, label="sensitivity |S|")
        right.loglog(hertz, np.abs(L * S), color=FREE, label="|T| = |1 − S|")
        highest = margins.maximum_sensitivity
        if math.isfinite(highest):
            right.axhline(highest, color=ALARM, lw=0.9, ls=(0, (4, 3)))
        else:
            highest = float(np.abs(S).max())
        right.set_ylim(max(1e-3, float(np.abs(S).min())), 3.0 * highest)
        right.set_xlabel("frequency (Hz)")
        right.legend(loc="lower left", ncols=2, bbox_to_anchor=(0, 1.0), borderaxespad=0.2)
        return interactive(figure)


def bode(tuning: Tuning) -> str:
    """Magnitude and phase of the open loop, with the gain and the phase margin where they are read."""
    plant, margins = tuning.task.loops[0], tuning.found.margins
    assert margins is not None
    grid = Frequencies.of(plant, 3000).at
    L = loop_response(plant, tuning.gains.vector, grid)
    hertz = grid / (2.0 * math.pi * plant.sample_time)
    size, phase = np.abs(L), np.degrees(np.unwrap(np.angle(L)))
    phase -= 360.0 * round((phase[0] + 90.0) / 360.0)  # an integrator begins at -90 degrees
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 3.6), layout="constrained")
        upper, lower = figure.subplots(2, 1, sharex=True)
        upper.loglog(hertz, size, color=WINDOW, label="open loop |L|")
        lower.semilogx(hertz, phase, color=WINDOW)
        upper.axhline(1.0, color=QUIET, lw=0.8)
        lower.axhline(-180.0, color=QUIET, lw=0.8)
        if margins.stable and margins.crossover > 0.0:
            at = margins.crossover / (2.0 * math.pi)
            there = float(np.interp(at, hertz, phase))
            label = f"phase margin {margins.phase_margin:.3g}°"
            lower.plot([at, at], [-180.0, there], color=ALARM, lw=1.4, label=label)
        crossed = np.flatnonzero((phase[1:] + 180.0) * (phase[:-1] + 180.0) < 0.0)
        if margins.stable and crossed.size and math.isfinite(margins.gain_margin):
            nearest = crossed[np.argmin(np.abs(np.log(size[crossed] * margins.gain_margin)))]
            label = f"gain margin {margins.gain_margin:.3g}"
            upper.plot([hertz[nearest]] * 2, [size[nearest], 1.0], color=ALARM, lw=1.4, label=label)
        upper.set_ylim(1e-3, float(min(size.max(), 1e4)))
        upper.set_ylabel("|L|")
        lower.set_ylabel("phase (°)")
        lower.set_xlabel("frequency (Hz)")
        for axes in (upper, lower):
            if axes.get_legend_handles_labels()[0]:
                axes.legend(loc="lower left")
        return interactive(figure)


def over_sizes(tuning: Tuning, rivals: Sequence[Scored], unit: str) -> str:
    """ITAE over the step's size, of each size, both directions.

    Args:
        tuning: its gains come first.
        rivals: baselines beside them.
        unit: of the output, SI.
    """
    factor, shown = friendly(unit)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 3.0), layout="constrained")
        axes = figure.subplots()
        for one, colour in [*zip(rivals, REST, strict=False), (tuning.found, WINDOW)]:
            rows = sorted(by_size(one.bench if tuning.on_bench else one.responses), key=lambda row: row.size)
            value = [row.itae_over_size if math.isfinite(row.itae_over_size) else math.nan for row in rows]
            own = one is tuning.found
            name = one.name.replace("_", " ")
            sizes = [factor * row.size for row in rows]
            axes.semilogy(sizes, value, marker="o", ms=4, color=colour, lw=1.7 if own else 0.9, label=name)
        axes.set_xlabel(axis_name("step", shown))
        axes.set_ylabel("ITAE over size (s²)")
        axes.legend(loc="lower left", ncols=4, bbox_to_anchor=(0, 1.0), borderaxespad=0.2)
        return interactive(figure)


def _few(tuning: Tuning) -> tuple[Task, int]:
    """The runs of a landscape, and its cells on a side: runs with friction are slow."""
    task = tuning.task
    if task.bench is None or not task.bench_alone:
        return replace(task, bench=None), CELLS
    chosen = few_episodes(task)
    chosen = chosen[:: max(len(chosen) // 3, 1)][:3] if tuning.on_bench else chosen
    return replace(task, bench=task.bench.only(chosen)), COARSE if tuning.on_bench else MIDDLE


def landscape(tuning: Tuning, pairs: Sequence[tuple[str, str]]) -> str:
    """Cost over pairs of gains, the others as tuned: decades above the best one; grey where a margin is missed."""
    task, cells = _few(tuning)
    best = float(task.fitness(tuning.gains.vector)[0])
    with mpl.rc_context({**STYLE, "axes.grid": False}):
        figure = Figure(figsize=(9.2, 3.7), layout="constrained")
        axes = figure.subplots(1, len(pairs), squeeze=False)[0]
        for axis, (across, up) in zip(axes, pairs, strict=True):
            x, y = _axis(tuning, across, cells), _axis(tuning, up, cells)
            gains = np.tile(tuning.gains.vector, (x.size * y.size, 1))
            gains[:, PLACES[across]], gains[:, PLACES[up]] = np.repeat(x, y.size), np.tile(y, x.size)
            cost = task.fitness(gains)
            decades = np.where(cost < REFUSED, np.log10(np.maximum(cost / best, 1e-9)), np.nan)
            # The gains of a reverse-acting plant are negative, so that a logarithm needs their magnitude.
            turned = [-1.0 if name in SIGNED and tuning.within.sign < 0.0 else 1.0 for name in (across, up)]
            image = _valley(axis, turned[0] * x, turned[1] * y, decades.reshape(x.size, y.size).T)
            axis.plot(
                [turned[0] * getattr(tuning.gains, across)],
                [turned[1] * getattr(tuning.gains, up)],
                marker="o",
                ms=5,
                mfc="white",
                mec=INK,
            )
            sides = ((across, axis.set_xscale, axis.xaxis), (up, axis.set_yscale, axis.yaxis))
            for name, scale, side in sides:
                if name in SIGNED and getattr(tuning.gains, name) * tuning.within.sign > 0.0:
                    scale("log")
                    side.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
                    side.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
                    side.set_minor_formatter(NullFormatter())
            axis.set_xlabel(across if turned[0] > 0.0 else f"−{across}")
            axis.set_ylabel(up if turned[1] > 0.0 else f"−{up}")
        figure.colorbar(image, ax=list(axes), label="cost, decades above the best", shrink=0.9)
        return interactive(figure)


def _valley(axis: Any, x: Array, y: Array, decades: Array) -> Any:
    """Colours, and lines at 5 %, 20 % and 100 % above the best, where they exist."""
    axis.set_facecolor("#dde1e5")
    image = axis.pcolormesh(
        x, y, decades, cmap=_shades(), vmin=0.0, vmax=WORTH, shading="nearest", rasterized=True
    )
    known = decades[np.isfinite(decades)]
    levels = [x for x in np.log10([1.05, 1.2, 2.0]) if known.size and known.min() < x < known.max()]
    if levels:
        axis.contour(x, y, decades, levels=levels, colors="white", linewidths=0.6)
    return image


def _shades() -> ListedColormap:
    return ListedColormap(mpl.colormaps["viridis_r"](np.linspace(0.05, 0.95, 64)))


def _axis(tuning: Tuning, name: str, cells: int) -> Array:
    """Values around a gain: a factor of five to each side, or the box for weights."""
    value = float(getattr(tuning.gains, name))
    column = tuning.within.free.index(name)
    high = float(tuning.within.high[column])
    if name.endswith("weight"):
        return np.linspace(0.0, high, cells)
    size = max(abs(value), 1e-3 * high)
    return math.copysign(1.0, value or tuning.within.sign) * np.geomspace(size / 5.0, 5.0 * size, cells)
