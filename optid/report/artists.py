"""The artists of a matplotlib figure as traces and shapes of Plotly's figure format."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PathCollection, QuadMesh
from matplotlib.colors import to_rgba
from matplotlib.contour import ContourSet
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle, StepPatch

from optid.report.vertices import DIGITS, colour, numbers, thin

POINT = 100 / 72  # pixels of a page per point of a figure


def traces(axes: Axes) -> Iterator[dict[str, Any]]:
    """All artists on the axes with values to hover over, from bottom to top."""
    for collection in axes.collections:
        yield from _of_collection(collection)
    patch: Any
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


def _of_collection(collection: Any) -> Iterator[dict[str, Any]]:
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


def shapes(axes: Axes) -> Iterator[dict[str, Any]]:
    """Lines and bands that run across the whole axes: "x" and "y" are references for the caller to number."""
    patch: Any
    for patch in axes.patches:
        if _is_span(patch, axes):
            (x, y), wide, high = patch.get_xy(), patch.get_width(), patch.get_height()
            yield {
                "type": "rect",
                **_span(patch.get_data_transform(), axes),
                "x0": x,
                "x1": x + wide,
                "y0": y,
                "y1": y + high,
                "fillcolor": colour(patch.get_facecolor()),
                "line": {"width": 0},
                "layer": "below",
                **_named(patch.get_label()),
            }
    for line in axes.lines:
        if line.get_transform() != axes.transData:
            across, up = (np.asarray(values, dtype=float) for values in line.get_data())
            if len(across) == 2:
                yield {
                    "type": "line",
                    **_span(line.get_transform(), axes),
                    "x0": across[0],
                    "x1": across[1],
                    "y0": up[0],
                    "y1": up[1],
                    "line": _stroke(line),
                    **_named(line.get_label()),
                }


def pictures(axes: Axes) -> Iterator[dict[str, Any]]:
    """Images and meshes as pictures that zoom with their axes."""
    for image in axes.images:
        left, right, bottom, top = image.get_extent()
        yield _picture(_pixels(image), (left, right), (bottom, top))
    for mesh in axes.collections:
        if isinstance(mesh, QuadMesh):
            yield _mesh(mesh)


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
        hollow = isinstance(face, str) and face == "none"
        own = line.get_color() if hollow else face
        found["marker"] = {
            "color": colour(own, line.get_alpha()),
            "size": max(2.5, POINT * line.get_markersize()),
            "symbol": _SYMBOLS.get(str(line.get_marker()), "circle") + ("-open" if hollow else ""),
            "line": {
                "color": colour(line.get_markeredgecolor()),
                "width": 1 if line.get_markersize() > 3 else 0,
            },
        }
    return found


_SYMBOLS = {
    "x": "x-thin",
    "+": "cross-thin",
    "s": "square",
    "^": "triangle-up",
    "v": "triangle-down",
    "D": "diamond",
}


def _dots(dots: Any) -> dict[str, Any]:
    at = np.asarray(dots.get_offsets(), dtype=float)
    faces = dots.get_facecolor() if len(dots.get_facecolor()) else dots.get_edgecolor()
    shade = [colour(face) for face in faces] if len(faces) > 1 else colour(faces[0])
    size = float(np.sqrt(np.mean(dots.get_sizes()))) * POINT
    return {
        "type": "scatter",
        "mode": "markers",
        "x": numbers(at[:, 0]),
        "y": numbers(at[:, 1]),
        "marker": {"color": shade, "size": max(2.5, size)},
        **_named(dots.get_label()),
    }


def _segments(lines: Any) -> dict[str, Any]:
    gap = np.full((1, 2), np.nan)
    joined = np.concatenate(
        [part for segment in lines.get_segments() for part in (np.asarray(segment), gap)] or [gap]
    )
    return {
        "type": "scatter",
        "mode": "lines",
        "x": numbers(joined[:, 0]),
        "y": numbers(joined[:, 1]),
        "connectgaps": False,
        "line": {"color": colour(lines.get_color()[0]), "width": POINT * float(lines.get_linewidth()[0])},
        **_named(lines.get_label()),
    }


def _contours(lines: Any) -> Iterator[dict[str, Any]]:
    for level, paths, shade in zip(lines.levels, lines.allsegs, lines.get_edgecolor(), strict=False):
        for path in paths:
            yield {
                "type": "scatter",
                "mode": "lines",
                "x": numbers(path[:, 0]),
                "y": numbers(path[:, 1]),
                "line": {"color": colour(shade), "width": 1},
                "name": f"{level:.3g}",
                "showlegend": False,
            }


def _cells(mesh: Any) -> dict[str, Any]:
    """An invisible trace over the picture, which gives the pointer its values."""
    corners: Any = mesh.get_coordinates()
    values: Any = np.ma.filled(np.ma.asarray(mesh.get_array(), dtype=float), np.nan)
    middles = (corners[:-1, :-1] + corners[1:, 1:]) / 2
    return {
        "type": "scatter",
        "mode": "markers",
        "x": numbers(middles[..., 0]),
        "y": numbers(middles[..., 1]),
        "text": [f"{value:.3g}" for value in values.ravel()],
        "hoverinfo": "x+y+text",
        "showlegend": False,
        "marker": {"opacity": 0, "size": 6},
    }


def _stairs(patch: Any) -> dict[str, Any]:
    data = patch.get_data()
    heights = np.r_[data.values, data.values[-1]]
    return {
        "type": "scatter",
        "mode": "lines",
        "x": numbers(data.edges),
        "y": numbers(heights),
        **_named(patch.get_label()),
        "line": {**_edge(patch), "shape": "hv"},
        **({"fill": "tozeroy", "fillcolor": colour(patch.get_facecolor())} if patch.get_fill() else {}),
    }


def _area(vertices: Any, faces: Any, label: object) -> dict[str, Any]:
    fill = colour(faces[0]) if len(faces) else "rgba(0,0,0,0)"
    at = np.asarray(vertices, dtype=float)
    return {
        "type": "scatter",
        "mode": "lines",
        "x": numbers(at[:, 0], DIGITS + 1),
        "y": numbers(at[:, 1]),
        "fill": "toself",
        "fillcolor": fill,
        "line": {"width": 0},
        "hoverinfo": "skip",
        **_named(label),
    }


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
    """The label of an artist, shown in the legend; those that begin with "_" are matplotlib's."""
    name = str(label or "_")
    return {"showlegend": False} if name.startswith("_") else {"name": name, "legendgroup": name}


def _is_span(patch: Patch, axes: Axes) -> bool:
    return isinstance(patch, Rectangle) and patch.get_data_transform() != axes.transData


def _span(transform: Any, axes: Axes) -> dict[str, str]:
    across, up = transform.contains_branch_seperately(axes.transData)
    return {"xref": "x" if across else "x domain", "yref": "y" if up else "y domain"}


def _mesh(mesh: Any) -> dict[str, Any]:
    corners = mesh.get_coordinates()
    across, up = (corners[0, 0, 0], corners[0, -1, 0]), (corners[0, 0, 1], corners[-1, 0, 1])
    return _picture(mesh.to_rgba(mesh.get_array())[::-1], across, up)


def _pixels(image: Any) -> Any:
    rgba = image.to_rgba(image.get_array())
    return rgba if image.origin == "upper" else rgba[::-1]


def _picture(rgba: Any, across: tuple[float, float], up: tuple[float, float]) -> dict[str, Any]:
    """An image over a range of both axes; its first row is the top."""
    buffer = io.BytesIO()
    mpl.image.imsave(buffer, np.clip(np.asarray(rgba), 0, 1), format="png")
    text = base64.b64encode(buffer.getvalue()).decode("ascii")
    return {"source": f"data:image/png;base64,{text}", "across": across, "up": up}
