"""The figure of a recording as it was read: every channel over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from optid.core.quantity import friendly
from optid.report.figures import ALARM, INK, QUIET, STYLE, axis_name

if TYPE_CHECKING:
    import pandas as pd


def channels(
    frame: pd.DataFrame, units: Mapping[str, str], remarks: Sequence[Mapping[str, Any]] = ()
) -> Figure:
    """One panel a channel; stretches and instants that a remark names are shaded.

    Args:
        frame: recording, time (s), and a column for each channel in its SI unit, of one recording.
        units: role -> SI unit.
        remarks: of check.json.
    """
    roles = [str(name) for name in frame if name not in ("recording", "time") and frame[name].notna().any()]
    time = np.asarray(frame["time"], dtype=float)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 0.6 + 1.4 * len(roles)), layout="constrained")
        axes: Any = figure.subplots(len(roles), 1, squeeze=False, sharex=True)[:, 0]
        for axis, role in zip(axes, roles, strict=True):
            factor, unit = friendly(units.get(role, "1"))
            axis.plot(time, factor * np.asarray(frame[role], dtype=float), color=INK, lw=0.9)
            axis.set_ylabel(axis_name(role, unit))
            _shade(axis, [one for one in remarks if one["channel"] in (role, "time")], float(np.ptp(time)))
        axes[-1].set_xlabel("time (s)")
        figure.align_ylabels()
        return figure


def _shade(axis: Any, remarks: Sequence[Mapping[str, Any]], duration: float) -> None:
    for one in remarks:
        if one["interval"]:
            start, stop = one["interval"]
            colour = ALARM if one["severity"] != "note" else QUIET
            axis.axvspan(start, max(stop, start + 0.002 * duration), color=colour, alpha=0.18, lw=0)
