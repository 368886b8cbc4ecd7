"""Axes to draw on where the caller has none."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure


def axes_or_new(axes: Axes | None, size: tuple[float, float] = (9.2, 3.4)) -> Axes:
    """The given axes, or those of a new figure without a window."""
    if axes is not None:
        return axes
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    made: Any = figure.subplots()
    return made  # type: ignore[no-any-return]
