"""The view of a profile likelihood."""

from __future__ import annotations

from matplotlib.axes import Axes

from optid.report import prediction_figures as figures
from optid.report.interactive import interactive
from optid.report.shell import render
from optid.report.views.canvas import axes_or_new
from optid.results.fit import ProfileResult


def plot(result: ProfileResult, axes: Axes | None = None) -> Axes:
    """Deviance over the parameter's value."""
    drawn = axes_or_new(axes)
    figures.profile(drawn, result.tables["profile"], result.document, result.document["parameter"])
    return drawn


def page(result: ProfileResult) -> str:
    """A page with the profile."""
    name = result.document["parameter"]
    figure = plot(result).get_figure(root=True)
    assert figure is not None
    return render(
        "single.html.j2",
        f"Profile likelihood of {name.replace('_', ' ')}",
        lead=result.summary(),
        figure=interactive(figure, f"profile of {name}"),
    )
