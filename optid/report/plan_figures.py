"""The figure of a plan: reference and predicted position over the predicted command."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from optid.experiments.files import Planned
from optid.live.settings import wiring_of
from optid.report.figures import ALARM, INK, QUIET, STYLE, WINDOW, axis_name, svg, thin
from optid.report.scores import friendly


def experiment(planned: Planned) -> str:
    """Reference, position and command with their limits; a line where a piece begins, numbered."""
    loop, run = planned.loop, planned.design.run
    factor, unit = friendly("m")
    limits, dashes = loop.settings.limits, (0, (4, 3))
    time = loop.settings.span * np.arange(float(run.command.size))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 5.0), layout="constrained")
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
        top.plot(*thin(time, factor * run.reference), color=QUIET, lw=1.0, label="reference")
        top.plot(*thin(time, factor * loop.position(run)), color=WINDOW, lw=1.3, label="position, predicted")
        bottom.plot(*thin(time, run.command), color=INK, lw=0.7)
        for axis, pair in (
            (top, [factor * value for value in limits.stroke]),
            (bottom, [limits.low, limits.high]),
        ):
            for value in pair:
                axis.axhline(value, color=ALARM, lw=0.8, ls=dashes)
            for begin in planned.design.starts:
                axis.axvline(begin, color=QUIET, lw=0.8)
        for number, begin in enumerate(planned.design.starts, 1):
            top.annotate(f"{number}", (begin, 1.0), xycoords=("data", "axes fraction"), xytext=(3, -10),
                         textcoords="offset points", fontsize=8, color=QUIET)  # fmt: skip
        top.margins(y=0.12)  # room for the numbers
        top.set_ylabel(axis_name("position", unit))
        top.legend(loc="lower left", ncols=2, bbox_to_anchor=(0, 1.0), borderaxespad=0.2)
        bottom.set_ylabel(axis_name("command", wiring_of(loop.rig).command.recorded_unit))
        bottom.set_xlabel("time (s)")
        figure.align_ylabels()
        return svg(figure)
