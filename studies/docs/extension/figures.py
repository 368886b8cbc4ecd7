"""A figure for each record of the atlas: what the sensor shows without and with the effect, command and change."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.lib.stride_tricks import sliding_window_view

from optid.core.model import Array
from optid.core.quantity import quantity, reading
from studies.docs.extension.runs import Record

WITHOUT, WITH, REFERENCE = "#8a8f98", "#c2410c", "#1f6f8b"


def draw(record: Record, path: Path) -> str:
    """Draw it, and say in a sentence what it shows."""
    e, c = record.excitation, record.column
    role, unit = record.roles[c], record.units[c]
    t = np.arange(e.samples) * e.step
    factor, name = _readable(record.outputs[:, :, c], unit)
    change = record.outputs[1, :, c] - record.outputs[0, :, c]
    span = _where(record.outputs[0, :, c], change, round((0.8 if e.step < 0.1 else 600.0) / e.step))
    words = role.replace("_", " ")

    figure = Figure(figsize=(8.6, 6.2), layout="constrained")
    top, middle, bottom = figure.subplots(3, 1, height_ratios=(2.2, 1, 1.3))
    if e.closed and c == 0:  # what the controller follows is the first output's
        top.plot(t[span], factor * e.reference[span], ":", color=REFERENCE, lw=1.2, label="reference")
    for row, color, label in ((0, WITHOUT, "without"), (1, WITH, f"with {record.effect.name}")):
        top.plot(t[span], factor * record.outputs[row, span, c], color=color, lw=1.6, label=label)
        middle.step(t[span], record.command[row, span], where="post", color=color, lw=1.2)
    top.set_ylabel(f"{words} ({name})")
    top.legend(loc="best", fontsize=8, frameon=False)
    unit_of_command = "share of full" if record.command_unit == "1" else record.command_unit
    middle.set_ylabel(f"command\n({unit_of_command})")
    middle.sharex(top)
    size, small = _readable(change, unit)
    bottom.axvspan(t[span][0], t[span][-1], color="#f1e4d8", lw=0)
    bottom.plot(t, size * change, color=WITH, lw=0.9)
    noise = e.noise[role]
    bottom.axhspan(-2 * size * noise, 2 * size * noise, color=WITHOUT, alpha=0.35, lw=0)
    bottom.set_ylabel(f"change ({small})")
    bottom.set_xlabel("time (s); above: the shaded part; grey band: ± 2 sd of usual noise")
    for axes in (top, middle, bottom):
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=110)
    largest = float(np.nanmax(np.abs(change)))
    return (
        f"it changes the {words} by up to {quantity(largest, unit)}, {largest / noise:.0f} sd of usual noise"
    )


def _readable(values: Array, unit: str) -> tuple[float, str]:
    """A factor and a unit in which the largest value reads well."""
    return reading(float(np.nanmax(np.abs(values))) or 1.0, unit)


def _where(without: Array, change: Array, samples: int) -> slice:
    """The part in which the change is plainest beside the motion, among those where it is large."""
    samples = min(samples, len(change))
    rows, change = sliding_window_view(without, samples)[::10], np.nan_to_num(change)
    size = np.sqrt(np.mean(sliding_window_view(change, samples)[::10] ** 2, axis=1))
    motion = np.ptp(rows, axis=1)
    moves = motion > 2.0 * size.max()  # at rest there is little to see, unless it never moves
    wanted = (size > 0.4 * size.max()) & (moves | ~moves.any())
    plain = np.where(wanted, size / (motion + 3.0 * size.max()), 0.0)
    first = 10 * int(np.argmax(plain))
    return slice(first, first + samples)
