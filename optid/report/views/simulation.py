"""The view of a simulation."""

from __future__ import annotations

from matplotlib.axes import Axes

from optid.report.shell import render
from optid.report.views.canvas import axes_or_new
from optid.report.views.predictions import exhibits, paths, plotted, score_table
from optid.results.simulation import SimulationResult


def plot(result: SimulationResult, axes: Axes | None = None) -> Axes:
    """Measured and predicted first output of the last recording."""
    drawn = axes_or_new(axes)
    plotted(result, drawn, "simulated")
    return drawn


def page(result: SimulationResult) -> str:
    """The report of `optid simulate`."""
    about, metrics = result.document["about"], result.metrics
    names = [entry["name"] for entry in about["recordings"]]
    shown = " ".join(paths(result, "simulated"))
    by_kind = [{role: kinds[kind] for role, kinds in metrics.items()} for kind in ("window", "free_run")]
    return render(
        "prediction.html.j2",
        f"{about['rig']}: simulation of {', '.join(names)}",
        about=about,
        lead=about["lead"],
        seconds=None,
        tables=[("simulated", score_table(*by_kind))],
        fit=None,
        exhibits=exhibits(result),
        unknowns=about["unknowns"],
        next_command=f"optid fit {about['rig_file']} {shown} --holdout OTHER --out out/fit",
    )
