"""A matplotlib figure as an interactive one: zoom, values, switching of traces, saving.

The figure is drawn once, with matplotlib: a notebook shows it as it is, a page gets its lines and axes in the format
of Plotly, whose own bundle (`optid/report/plotly`) draws them in the browser.
"""

from __future__ import annotations

import base64
import gzip
import json
import math
import os
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FixedLocator, NullLocator

from optid.report.artists import pictures, shapes, traces
from optid.report.bundle import BUNDLE, SHARED
from optid.report.vertices import colour, numbers

HERE = Path(__file__).parent
PIXELS = 100  # of a page per inch of a figure


def interactive(figure: Figure, name: str = "figure") -> Markup:
    """The figure as HTML for a page that holds `library()`.

    Args:
        figure: with its layout; drawn for the places of its axes.
        name: of the file that the reader may save it as.
    """
    FigureCanvasAgg(figure)
    figure.draw_without_rendering()
    content = json.dumps(specification(figure, name), separators=(",", ":"), allow_nan=False)
    high = figure.get_figheight() * PIXELS
    return Markup(
        '<div class="figure" style="height:{:.0f}px"><script type="application/gzip">{}</script></div>'
    ).format(high, Markup(packed(content)))


def library(shared: str | None = None) -> Markup:
    """The bundle that draws figures and the call of it, for the end of a page's body.

    Args:
        shared: address of the bundle relative to the page; the environment's if absent; without either it is embedded.
    """
    address = shared or os.environ.get(SHARED, "")
    start = (HERE / "figures.js").read_text(encoding="utf-8")
    bundle = Markup('<script src="{}"></script>').format(address) if address else _inside()
    return bundle + Markup("\n<script>\n{}</script>").format(Markup(start))


@cache
def _inside() -> Markup:
    bundle = packed((HERE / "plotly" / BUNDLE).read_text(encoding="utf-8"))
    return Markup('<script type="application/gzip" id="plotly">{}</script>').format(Markup(bundle))


def packed(text: str) -> str:
    """Compressed text that HTML can hold."""
    return base64.b64encode(gzip.compress(text.encode("utf-8"), 9, mtime=0)).decode("ascii")


def specification(figure: Figure, name: str) -> dict[str, Any]:
    """The figure's data and layout in Plotly's format."""
    data: list[dict[str, Any]] = []
    layout: dict[str, Any] = {
        "autosize": True,
        "margin": {"l": 0, "r": 0, "t": 0, "b": 0},
        "hovermode": "closest",
        "shapes": [],
        "images": [],
        "annotations": [],
        "showlegend": True,
        "dragmode": "zoom",
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
    }
    every = [axes for axes in figure.axes if axes.get_visible()]
    for number, axes in enumerate(every, 1):
        x, y, legend = (f"{kind}{number if number > 1 else ''}" for kind in ("x", "y", "legend"))
        layout[x.replace("x", "xaxis")], layout[y.replace("y", "yaxis")] = _axis_pair(axes, every, x, y)
        own = [{**trace, "xaxis": x, "yaxis": y, "legend": legend} for trace in traces(axes)]
        named = axes.get_legend()
        for trace in own:
            trace["showlegend"] = trace.get("showlegend", True) and named is not None
        data += own or [{"type": "scatter", "x": [], "y": [], "xaxis": x, "yaxis": y, "showlegend": False}]
        layout["shapes"] += [_shape(shape, x, y, legend, named is not None) for shape in shapes(axes)]
        layout["images"] += [_image(picture, axes, x, y) for picture in pictures(axes)]
        layout["annotations"] += [*_titles(axes), *_texts(axes, x, y)]
        if named is not None:
            layout[legend] = _legend(named, figure)
    return {"data": data, "layout": layout, "name": name}


def _axis_pair(axes: Axes, every: list[Axes], x: str, y: str) -> tuple[dict[str, Any], dict[str, Any]]:
    box = axes.get_position()
    across = {**_axis(axes.xaxis, axes.get_xlim()), "domain": _within(box.x0, box.x1), "anchor": y}
    up = {**_axis(axes.yaxis, axes.get_ylim()), "domain": _within(box.y0, box.y1), "anchor": x}
    first = every.index(axes)
    for number, other in enumerate(every[:first], 1):
        suffix = number if number > 1 else ""
        if axes.get_shared_x_axes().joined(axes, other) and "matches" not in across:
            across["matches"] = f"x{suffix}"
            if other.get_position().bounds == box.bounds:
                up |= {"overlaying": f"y{suffix}", "side": "right"}
        if axes.get_shared_y_axes().joined(axes, other) and "matches" not in up:
            up["matches"] = f"y{suffix}"
    if axes.yaxis.get_ticks_position() == "right":
        up["side"] = "right"
    if axes.get_aspect() == 1.0:
        up |= {"scaleanchor": x, "constrain": "domain"}
        across["constrain"] = "domain"
    return across, up


def _within(low: float, high: float) -> list[float]:
    return [max(0.0, float(low)), min(1.0, float(high))]


def _axis(axis: Any, limits: tuple[float, float]) -> dict[str, Any]:
    logarithmic = axis.get_scale() == "log"
    ends = [math.log10(value) for value in limits] if logarithmic else [float(value) for value in limits]
    shown = axis.get_tick_params(which="major")
    found: dict[str, Any] = {
        "type": "log" if logarithmic else "linear",
        "range": ends,
        "zeroline": False,
        "title": {"text": axis.get_label_text(), "standoff": 4},
        "showticklabels": bool(shown.get("labelbottom", shown.get("labelleft", True))),
        "showgrid": bool(shown.get("gridOn", True)),
        "exponentformat": "power",
    }
    if axis.get_ticks_position() == "right":
        found["showticklabels"] = True
    located, written = axis.get_major_locator(), axis.get_major_formatter()
    fixed = np.asarray(located.locs) if isinstance(located, FixedLocator) else None  # type: ignore[attr-defined]
    if isinstance(located, NullLocator) or (fixed is not None and not fixed.size):
        found |= {"showticklabels": False, "showgrid": False}
    elif fixed is not None and isinstance(written, FixedFormatter):
        found |= {"tickmode": "array", "tickvals": numbers(fixed), "ticktext": list(written.seq)}
    return found


def _shape(shape: dict[str, Any], x: str, y: str, legend: str, named: bool) -> dict[str, Any]:
    references = {"xref": shape["xref"].replace("x", x, 1), "yref": shape["yref"].replace("y", y, 1)}
    there = shape.get("showlegend", "name" in shape) and named
    return {**shape, **references, "showlegend": there, **({"legend": legend} if there else {})}


def _image(picture: dict[str, Any], axes: Axes, x: str, y: str) -> dict[str, Any]:
    (left, right), (bottom, top) = (
        [math.log10(v) for v in ends] if scale == "log" else [float(v) for v in ends]
        for ends, scale in ((picture["across"], axes.get_xscale()), (picture["up"], axes.get_yscale()))
    )
    return {
        "source": picture["source"],
        "xref": x,
        "yref": y,
        "x": left,
        "y": top,
        "sizex": right - left,
        "sizey": top - bottom,
        "sizing": "stretch",
        "layer": "below",
    }


def _titles(axes: Axes) -> list[dict[str, Any]]:
    box, found = axes.get_position(), []
    for place, at in (("left", box.x0), ("center", (box.x0 + box.x1) / 2), ("right", box.x1)):
        if text := axes.get_title(loc=place):  # type: ignore[arg-type]
            found.append(
                {
                    "text": text,
                    "xref": "paper",
                    "yref": "paper",
                    "x": at,
                    "y": box.y1,
                    "xanchor": place,
                    "yanchor": "bottom",
                    "showarrow": False,
                }
            )
    return found


def _texts(axes: Axes, x: str, y: str) -> list[dict[str, Any]]:
    found = []
    for text in axes.texts:
        corner = axes.transData.inverted().transform(text.get_window_extent().min)
        across, up = (
            math.log10(value) if scale == "log" and value > 0 else float(value)
            for value, scale in zip(corner, (axes.get_xscale(), axes.get_yscale()), strict=True)
        )
        found.append(
            {
                "text": text.get_text(),
                "xref": x,
                "yref": y,
                "x": across,
                "y": up,
                "xanchor": "left",
                "yanchor": "bottom",
                "showarrow": False,
                "font": {"color": colour(text.get_color()), "size": 11},
            }
        )
    return found


def _legend(legend: Any, figure: Figure) -> dict[str, Any]:
    box = legend.get_window_extent().transformed(figure.transFigure.inverted())
    across = getattr(legend, "_ncols", 1) > 1
    return {
        "x": min(max(float(box.x0), 0.0), 1.0),
        "y": min(max(float(box.y0), 0.0), 1.0),
        "xanchor": "left",
        "yanchor": "bottom",
        "orientation": "h" if across else "v",
        "bgcolor": "rgba(0,0,0,0)",
        "itemwidth": 30,
    }
