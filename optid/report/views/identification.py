"""The view of identified models."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from optid.report.figures import ALARM, FREE, QUIET, WINDOW
from optid.report.interactive import interactive
from optid.report.prediction_figures import ABOVE
from optid.report.shell import render
from optid.report.views.canvas import axes_or_new
from optid.results.identification import IdentificationResult

COLOURS = (WINDOW, FREE, ALARM, QUIET)
POINTS = 400


def plot(result: IdentificationResult, axes: Axes | None = None) -> Axes:
    """Gain over frequency of every model, from its first input."""
    drawn, contents = axes_or_new(axes), result.contents
    for number, saved in enumerate(contents.models):
        model = saved.model
        turn = np.geomspace(1e-4, np.pi, POINTS)
        z = np.exp(1j * turn)
        numerator, denominator = model.powers_of_z(0)
        gain = np.abs(np.polyval(numerator, z) / np.polyval(denominator, z))
        order = model.orders.na
        label = f"order {order}{', recommended' if order == contents.recommended else ''}"
        drawn.loglog(
            turn / (2 * np.pi * model.sample_time), gain, color=COLOURS[number % len(COLOURS)], label=label
        )
    units = f"{contents.output_unit or '1'} per {contents.input_unit or '1'}"
    drawn.set_xlabel("frequency (Hz)")
    drawn.set_ylabel(f"gain ({units})")
    drawn.legend(ncols=4, **ABOVE)
    return drawn


def page(result: IdentificationResult) -> str:
    """A page for models without one of `optid identify`."""
    figure = plot(result).get_figure(root=True)
    assert figure is not None
    return render("single.html.j2", "ARMAX models", lead=result.summary(), figure=interactive(figure, "gain"))
