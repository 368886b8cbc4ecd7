"""The view of tuned gains."""

from __future__ import annotations

from matplotlib.axes import Axes

from optid.core.quantity import friendly
from optid.report.figures import QUIET, WINDOW, axis_name
from optid.report.interactive import interactive
from optid.report.prediction_figures import ABOVE
from optid.report.shell import render
from optid.report.views.canvas import axes_or_new
from optid.results.tuning import TuningResult


def plot(result: TuningResult, axes: Axes | None = None) -> Axes:
    """Response of the identified model in the first episode; the costs where no response was stored."""
    drawn = axes_or_new(axes)
    frame = result.tables.get("responses")
    if frame is None:
        costs = result.to_frame().dropna(subset=["itae"])
        drawn.barh(costs["name"], costs["itae"], color=WINDOW)
        drawn.set_xlabel("ITAE")
        return drawn
    name = frame["episode"].iloc[0]
    first = frame[frame["episode"] == name]
    factor, unit = friendly(result.document["units"]["itae"].split()[0])
    drawn.plot(
        first["time"],
        factor * first["reference"],
        color=QUIET,
        lw=1.0,
        drawstyle="steps-post",
        label="reference",
    )
    drawn.plot(first["time"], factor * first["output"], color=WINDOW, lw=1.3, label=str(name))
    drawn.set_xlabel("time (s)")
    drawn.set_ylabel(axis_name("output", unit))
    drawn.legend(ncols=2, **ABOVE)
    return drawn


def page(result: TuningResult) -> str:
    """A page for gains without one of `optid tune`."""
    figure = plot(result).get_figure(root=True)
    assert figure is not None
    return render(
        "single.html.j2", "PID gains", lead=result.summary(), figure=interactive(figure, "response")
    )
