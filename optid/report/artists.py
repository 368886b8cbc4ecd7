"""What matplotlib has drawn, as traces and shapes of Plotly's figure format."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Iterator
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PathCollection, QuadMesh
from matplotlib.colors import to_rgba
from matplotlib.contour import ContourSet
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle, StepPatch
from numpy.typing import NDArray

Array = NDArray[np.float64]

POINTS = 3000  # vertices that a line keeps: more than the pixels of a page, and fewer than its bytes
POINT = 100 / 72  # pixels of a page per point of a figure
DIGITS = 4  # decimal places of a line's own range that a page holds: a thousand pixels show three


def traces(axes: Axes) -> Iterator[dict[str, Any]]:
    """Everything on the axes that has values to hover over, bottom up."""
    for collection in axes.collections:
        if isinstance(collection, PathCollection):
            yield _dots(collection)
        elif isinstance(collection, LineCollection):
            yield _segments(collection)
        elif isinstance(collection, QuadMesh):
            yield _cells(collection)
        elif isinstance(collection, ContourSet):
            yield from _contours(collection)
        else:
            for path in collection.get_paths():
                yield _area(path.vertices, collection.get_facecolor()[:1], collection.get_label())
    for patch in axes.patches:
        if isinstance(patch, StepPatch):
            yield _stairs(patch)
        elif not _is_span(patch, axes):
            vertices = patch.get_path().interpolated(8).vertices
            placed = patch.get_patch_transform().transform(vertices)
            yield {**_area(placed, [patch.get_facecolor()], patch.get_label()), "line": _edge(patch)}
    for line in axes.lines:
        if line.get_transform() == axes.transData:
            yield _line(line)


def shapes(axes: Axes) -> Iterator[dict[str, Any]]:
    """Lines and bands that run across the whole axes: "x" and "y" are references for the caller to number."""
    for patch in axes.patches:
        if isinstance(patch, Rectangle) and _is_span(patch, axes):
            (x, y), wide, high = patch.get_xy(), patch.get_width(), patch.get_height()
            yield {
                "type": "rect", **_span(patch.get_data_transform(), axes), "x0": x, "x1": x + wide, "y0": y, "y1": y + high,
                "fillcolor": colour(patch.get_facecolor()), "line": {"width": 0}, "layer": "below",
                **_named(patch.get_label()),
            }  # fmt: skip
    for line in axes.lines:
        if line.get_transform() != axes.transData:
            x, y = (np.asarray(values, dtype=float) for values in line.get_data())
            if len(x) == 2:
                yield {
                    "type": "line", **_span(line.get_transform(), axes), "x0": x[0], "x1": x[1], "y0": y[0],
                    "y1": y[1], "line": _stroke(line), **_named(line.get_label()),
                }  # fmt: skip


def pictures(axes: Axes) -> Iterator[dict[str, Any]]:
    """Images and meshes as pictures that zoom with their axes."""
    for image in axes.images:
        left, right, bottom, top = image.get_extent()
        yield _picture(_pixels(image), (left, right), (bottom, top))
    for mesh in axes.collections:
        if isinstance(mesh, QuadMesh):
            corners = mesh.get_coordinates()
            rgba = mesh.to_rgba(mesh.get_array())[::-1]
            yield _picture(rgba, (corners[0, 0, 0], corners[0, -1, 0]), (corners[0, 0, 1], corners[-1, 0, 1]))


def colour(value: Any, alpha: float | None = None) -> str:
    """A colour as a page writes it."""
    red, green, blue, opacity = to_rgba(value, alpha)
    return f"rgba({red * 255:.0f},{green * 255:.0f},{blue * 255:.0f},{opacity:.3g})"


def thin(x: Array, y: Array, points: int = POINTS) -> tuple[Array, Array]:
    """Lowest and highest value of every stretch, so that no spike is lost."""
    if len(y) <= points:
        return x, y
    size = -(-len(y) // (points // 2))
    rows = np.r_[y, np.full(-len(y) % size, np.nan)].reshape(-1, size)
    known = np.isfinite(rows)
    low = np.argmin(np.where(known, rows, np.inf), axis=1)
    high = np.argmax(np.where(known, rows, -np.inf), axis=1)
    picked = np.sort(np.c_[low, high], axis=1) + size * np.arange(len(rows))[:, None]
    at = np.minimum(picked.ravel(), len(y) - 1)
    return x[at], y[at]


def numbers(values: Any, digits: int = DIGITS) -> list[float | None]:
    """Rounded to what a page shows; ``None`` for what is not finite."""
    array = np.asarray(values, dtype=float).ravel()
    known = array[np.isfinite(array)]
    span = float(np.ptp(known)) or float(np.abs(known).max()) if known.size else 0.0
    places = digits - math.floor(math.log10(span)) if span > 0 else digits
    rounded = np.round(array, min(max(places, -300), 300)) + 0.0  # no minus zero
    return [value if math.isfinite(value) else None for value in rounded.tolist()]


def _line(line: Line2D) -> dict[str, Any]:
    x, y = (np.asarray(values, dtype=float) for values in line.get_data(orig=False))
    stepped = str(line.get_drawstyle()).startswith("steps")
    joined, marked = (
        line.get_linestyle() not in ("None", " ", ""),
        line.get_marker() not in ("None", None, "", " "),
    )
    if joined and x.size and (np.diff(x) >= 0).all():
        x, y = thin(x, y)
    mode = "+".join(word for word, there in (("lines", joined), ("markers", marked)) if there) or "lines"
    found = {
        "type": "scatter",
        "mode": mode,
        "x": numbers(x, DIGITS + 1),
        "y": numbers(y),
        **_named(line.get_label()),
    }
    if joined:
        found["line"] = {**_stroke(line), "shape": "hv" if stepped else "linear"}
    if marked:
        face = line.get_markerfacecolor()
        own = line.get_color() if isinstance(face, str) and face == "none" else face
        found["marker"] = {
            "color": colour(own, line.get_alpha()), "size": max(2.5, POINT * line.get_markersize()),
            "symbol": _SYMBOLS.get(str(line.get_marker()), "circle"),
            "line": {"color": colour(line.get_markeredgecolor()), "width": 1 if line.get_markersize() > 3 else 0},
        }  # fmt: skip
    return found


_SYMBOLS = {
    "x": "x-thin",
    "+": "cross-thin",
    "s": "square",
    "^": "triangle-up",
    "v": "triangle-down",
    "D": "diamond",
}


def _dots(dots: PathCollection) -> dict[str, Any]:
    at = np.asarray(dots.get_offsets(), dtype=float)
    faces = dots.get_facecolor() if len(dots.get_facecolor()) else dots.get_edgecolor()
    shade = [colour(face) for face in faces] if len(faces) > 1 else colour(faces[0])
    size = float(np.sqrt(np.mean(dots.get_sizes()))) * POINT
    return {
        "type": "scatter", "mode": "markers", "x": numbers(at[:, 0]), "y": numbers(at[:, 1]),
        "marker": {"color": shade, "size": max(2.5, size)}, **_named(dots.get_label()),
    }  # fmt: skip


def _segments(lines: LineCollection) -> dict[str, Any]:
    gap = np.full((1, 2), np.nan)
    joined = np.concatenate(
        [part for segment in lines.get_segments() for part in (np.asarray(segment), gap)] or [gap]
    )
    return {
        "type": "scatter", "mode": "lines", "x": numbers(joined[:, 0]), "y": numbers(joined[:, 1]), "connectgaps": False,
        "line": {"color": colour(lines.get_color()[0]), "width": POINT * float(lines.get_linewidth()[0])},
        **_named(lines.get_label()),
    }  # fmt: skip


def _contours(lines: ContourSet) -> Iterator[dict[str, Any]]:
    for level, paths, shade in zip(lines.levels, lines.allsegs, lines.get_edgecolor(), strict=False):
        for path in paths:
            yield {
                "type": "scatter", "mode": "lines", "x": numbers(path[:, 0]), "y": numbers(path[:, 1]),
                "line": {"color": colour(shade), "width": 1}, "name": f"{level:.3g}", "showlegend": False,
            }  # fmt: skip


def _cells(mesh: QuadMesh) -> dict[str, Any]:
    """Nothing to see, the picture is below it: where the pointer finds the values."""
    corners, values = (
        mesh.get_coordinates(),
        np.ma.filled(np.ma.asarray(mesh.get_array(), dtype=float), np.nan),
    )
    middles = (corners[:-1, :-1] + corners[1:, 1:]) / 2
    return {
        "type": "scatter", "mode": "markers", "x": numbers(middles[..., 0]), "y": numbers(middles[..., 1]),
        "text": [f"{value:.3g}" for value in values.ravel()], "hoverinfo": "x+y+text", "showlegend": False,
        "marker": {"opacity": 0, "size": 6},
    }  # fmt: skip


def _stairs(patch: StepPatch) -> dict[str, Any]:
    data = patch.get_data()
    heights = np.r_[data.values, data.values[-1]]
    return {
        "type": "scatter", "mode": "lines", "x": numbers(data.edges), "y": numbers(heights), **_named(patch.get_label()),
        "line": {**_edge(patch), "shape": "hv"},
        **({"fill": "tozeroy", "fillcolor": colour(patch.get_facecolor())} if patch.get_fill() else {}),
    }  # fmt: skip


def _area(vertices: Any, faces: Any, label: object) -> dict[str, Any]:
    fill = colour(faces[0]) if len(faces) else "rgba(0,0,0,0)"
    at = np.asarray(vertices, dtype=float)
    return {
        "type": "scatter", "mode": "lines", "x": numbers(at[:, 0], DIGITS + 1), "y": numbers(at[:, 1]), "fill": "toself",
        "fillcolor": fill, "line": {"width": 0}, "hoverinfo": "skip", **_named(label),
    }  # fmt: skip


def _edge(patch: Patch) -> dict[str, Any]:
    wide = patch.get_linewidth() if to_rgba(patch.get_edgecolor())[3] else 0.0
    return {"color": colour(patch.get_edgecolor()), "width": POINT * wide}


def _stroke(line: Line2D) -> dict[str, Any]:
    dashes: Any = getattr(line, "_unscaled_dash_pattern", (0, None))[1]
    found: dict[str, Any] = {
        "color": colour(line.get_color(), line.get_alpha()),
        "width": POINT * line.get_linewidth(),
    }
    if dashes:
        found["dash"] = ",".join(f"{POINT * line.get_linewidth() * d:.1f}px" for d in dashes)
    return found


def _named(label: object) -> dict[str, Any]:
    """A label of one's own is shown and switches; those that begin with "_" are matplotlib's."""
    name = str(label or "_")
    return {"showlegend": False} if name.startswith("_") else {"name": name, "legendgroup": name}


def _is_span(patch: Patch, axes: Axes) -> bool:
    return isinstance(patch, Rectangle) and patch.get_data_transform() != axes.transData


def _span(transform: Any, axes: Axes) -> dict[str, str]:
    across, up = transform.contains_branch_seperately(axes.transData)
    return {"xref": "x" if across else "x domain", "yref": "y" if up else "y domain"}


def _pixels(image: AxesImage) -> Any:
    rgba = image.to_rgba(image.get_array())
    return rgba if image.origin == "upper" else rgba[::-1]


def _picture(rgba: Any, across: tuple[float, float], up: tuple[float, float]) -> dict[str, Any]:
    """An image over a range of both axes; its first row is the top."""
    buffer = io.BytesIO()
    mpl.image.imsave(buffer, np.clip(np.asarray(rgba), 0, 1), format="png")
    text = base64.b64encode(buffer.getvalue()).decode("ascii")
    return {"source": f"data:image/png;base64,{text}", "across": across, "up": up}
