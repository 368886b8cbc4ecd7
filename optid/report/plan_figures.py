"""The figure of a plan: reference and predicted position, above the predicted command."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from optid.core.quantity import friendly
from optid.report.figures import ALARM, INK, QUIET, STYLE, WINDOW, axis_name
from optid.report.prediction_figures import ABOVE

if TYPE_CHECKING:
    import pandas as pd

DASHES = (0, (4, 3))


def experiment(frame: pd.DataFrame, document: Mapping[str, Any]) -> Figure:
    """Reference, position and command with their limits; a line where a piece begins, numbered.

    Args:
        frame: time (s), reference and position (m), command.
        document: of the plan.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 5.0), layout="constrained")
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
        positions(top, frame, document)
        bottom.plot(frame["time"], frame["command"], color=INK, lw=0.7)
        for value in document["limits"]["command"]:
            bottom.axhline(value, color=ALARM, lw=0.8, ls=DASHES)
        starts = document["about"]["starts"]
        for begin in starts:
            bottom.axvline(begin, color=QUIET, lw=0.8)
        bottom.set_ylabel(axis_name("command", document["limits"]["command_unit"]))
        bottom.set_xlabel("time (s)")
        figure.align_ylabels()
        return figure


def positions(axes: Any, frame: pd.DataFrame, document: Mapping[str, Any]) -> None:
    """Reference and predicted position on given axes, with the limits of the stroke and the pieces' numbers."""
    factor, unit = friendly("m")
    time = np.asarray(frame["time"], dtype=float)
    for name, colour, width, label in (
        ("reference", QUIET, 1.0, "reference"),
        ("position", WINDOW, 1.3, "position, predicted"),
    ):
        axes.plot(time, factor * np.asarray(frame[name], dtype=float), color=colour, lw=width, label=label)
    for value in document["limits"]["position"]:
        axes.axhline(factor * value, color=ALARM, lw=0.8, ls=DASHES)
    axes.margins(y=0.12)  # room for the numbers
    for number, begin in enumerate(document["about"]["starts"], 1):
        axes.axvline(begin, color=QUIET, lw=0.8)
        axes.annotate(
            f"{number}",
            (begin, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(3, -10),
            textcoords="offset points",
            fontsize=8,
            color=QUIET,
        )
    axes.set_ylabel(axis_name("position", unit))
    axes.legend(ncols=2, **ABOVE)
