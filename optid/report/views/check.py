"""The view of a check."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes

from optid.core.quantity import friendly
from optid.report.check_figures import channels
from optid.report.figures import INK, QUIET, axis_name
from optid.report.interactive import interactive
from optid.report.shell import render
from optid.report.views.canvas import axes_or_new
from optid.report.views.predictions import part
from optid.results.check import CheckResult


def plot(result: CheckResult, axes: Axes | None = None) -> Axes:
    """The first recording's channels, each over its own range."""
    drawn = axes_or_new(axes)
    units = result.document["about"]["units"]
    name = result.document["recordings"][0]["name"]
    frame = part(result.tables["signals"], name)
    roles = [str(column) for column in frame if column not in ("recording", "time")]
    for number, role in enumerate(roles):
        values = np.asarray(frame[role], dtype=float)
        factor, unit = friendly(units.get(role, "1"))
        most = float(np.nanmax(np.abs(values))) or 1.0
        label = f"{axis_name(role, unit)}, of {factor * most:.3g}"
        drawn.plot(
            frame["time"],
            values / most + 2.2 * (len(roles) - 1 - number),
            lw=0.9,
            label=label,
            color=(INK, QUIET)[number % 2],
        )
    drawn.set_yticks([])
    drawn.set_xlabel(f"time of {name} (s)")
    drawn.legend(loc="upper right")
    return drawn


def page(result: CheckResult) -> str:
    """The report of `optid check`."""
    d, about = result.document, result.document["about"]
    return render(
        "check.html.j2",
        f"{about['rig']}: check",
        about=about,
        lead=d["summary"].removesuffix(f" Next: {d['next']}").removesuffix("."),
        recordings=[{**entry, "figure": _figure(result, entry)} for entry in d["recordings"]],
        identifiability=d["identifiability"],
        detectability=result.detectability[1:],
        next_command=d["next"],
    )


def _figure(result: CheckResult, entry: Mapping[str, Any]) -> Markup:
    frame = part(result.tables["signals"], entry["name"])
    units = result.document["about"]["units"]
    return interactive(channels(frame, units, entry["remarks"]), entry["name"])
