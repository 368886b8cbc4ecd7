"""A matplotlib figure as text for a notebook: no state of pyplot, no file on the way."""

from __future__ import annotations

import io
from typing import Any

from matplotlib.backends.backend_svg import FigureCanvasSVG


def svg(figure: Any) -> str:
    """A `matplotlib.figure.Figure` as SVG, without the heading that makes it a file of its own."""
    buffer = io.BytesIO()
    FigureCanvasSVG(figure)
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue().decode("utf-8")
    return text[text.index("<svg") :]
