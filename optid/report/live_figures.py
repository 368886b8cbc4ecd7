"""Figures of a session: the rig and its models, over a stretch and around one step, and a review of gains."""

from __future__ import annotations

import math
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from optid.core.quantity import friendly
from optid.live.results import Stretch
from optid.live.review import Review
from optid.report.figures import ALARM, FREE, INK, QUIET, STYLE, WINDOW, axis_name, thin
from optid.report.interactive import interactive

LINES = (  # of a stretch: what, colour, width
    ("reference", QUIET, 1.0),
    ("real", INK, 1.7),
    ("predicted", WINDOW, 1.0),
    ("simulated", FREE, 1.1),
)


def stretch(part: Stretch) -> str:
    """Position of rig and models, above the command with its limits."""
    factor, unit = friendly(part.unit)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 4.3), layout="constrained")
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
        for name, colour, width in LINES:
            top.plot(
                *thin(part.time, factor * part.positions[name]),
                color=colour,
                lw=width,
                label=name,
                ls=(0, (5, 3)) if name == "reference" else "-",
            )
        top.set_ylabel(axis_name(part.role, unit))
        top.legend(loc="lower left", ncols=4, bbox_to_anchor=(0, 1.0), borderaxespad=0.2)
        bottom.plot(*thin(part.time, part.command), color=INK, lw=0.9)
        for value in part.limits:
            bottom.axhline(value, color=ALARM, lw=0.8, ls=(0, (4, 3)))
        bottom.set_ylabel(axis_name("command", part.command_unit))
        bottom.set_xlabel("time (s)")
        figure.align_ylabels()
        return interactive(figure)


def review(one: Review, unit: str) -> str:
    """Responses of the identified and the physical model to a step, with the old and the new gains."""
    factor, shown = friendly(unit)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 3.0), layout="constrained")
        axes: Any = figure.subplots(1, 2, sharey=True)
        for axis, (model, pair) in zip(axes, one.responses.items(), strict=True):
            for name, run, colour in zip(("old", "new"), pair, (QUIET, WINDOW), strict=True):
                itae = run.measures["itae"]
                words = f"{name} gains, ITAE {itae:.3g}" if math.isfinite(itae) else f"{name} gains run away"
                time = one.sample_time * np.arange(float(run.output.size))
                axis.plot(*thin(time, factor * run.output), color=colour, label=words)
            axis.axhline(factor * one.step, color=INK, lw=0.7, ls=(0, (4, 3)))
            axis.set_title(f"{model} model", loc="left", fontsize=9, color="#4a525c")
            axis.set_xlabel("time (s)")
            axis.legend(loc="lower right")
        axes[0].set_ylabel(axis_name("position", shown))
        return interactive(figure)
