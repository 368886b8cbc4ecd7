"""The paper's figures 1 to 4, 6, 7 and 13 as diagrams: valve, cylinder, identification, mixed reality, loops."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch, Rectangle

INK, AIR, QUIET = "#2b2f36", "#0a7e8c", "#9aa3ad"
Point = tuple[float, float]


def canvas(width: float, height: float) -> tuple[Figure, Axes]:
    """A blank figure whose axes count in units of its own."""
    figure = Figure(figsize=(0.8 * width, 0.8 * height), layout="constrained")
    axes = figure.subplots()
    axes.set_xlim(0, width)
    axes.set_ylim(0, height)
    axes.set_aspect("equal")
    axes.axis("off")
    return figure, axes


def box(axes: Axes, at: Point, text: str, size: Point = (2.2, 0.9), colour: str = INK) -> None:
    """A block with its centre at `at`."""
    corner = at[0] - size[0] / 2, at[1] - size[1] / 2
    axes.add_patch(FancyBboxPatch(corner, *size, boxstyle="round,pad=0.02", fc="white", ec=colour, lw=1.2))
    axes.text(*at, text, ha="center", va="center", fontsize=8, color=INK)


def arrow(axes: Axes, *points: Point, text: str = "", colour: str = INK) -> None:
    """A line through points with a head at the last one, its text beside the middle of the first stretch."""
    for start, end in itertools.pairwise(points[:-1]):
        axes.plot([start[0], end[0]], [start[1], end[1]], color=colour, lw=1.1, solid_capstyle="round")
    axes.annotate("", points[-1], points[-2], arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.1})
    if text:
        (x, y), upright = np.mean(points[:2], axis=0), points[0][0] == points[1][0]
        at, ha, va = ((x + 0.1, y), "left", "center") if upright else ((x, y + 0.12), "center", "bottom")
        axes.text(*at, text, ha=ha, va=va, fontsize=7.5, color=colour)


def node(axes: Axes, at: Point, sign: str = "−") -> None:
    """A comparison."""
    axes.plot(*at, "o", ms=13, mfc="white", mec=INK)
    axes.text(*at, sign, ha="center", va="center", fontsize=9)


def cylinder(axes: Axes, left: float, low: float, width: float = 6.0) -> None:
    """Cylinder with both chambers, piston, rod and load."""
    axes.add_patch(Rectangle((left, low), width, 1.6, fill=False, ec=INK, lw=1.4))
    axes.add_patch(Rectangle((left + 0.05, low + 0.05), 0.45 * width, 1.5, fc=AIR, alpha=0.15, lw=0))
    axes.add_patch(
        Rectangle((left + 0.45 * width + 0.3, low + 0.05), 0.55 * width - 0.35, 1.5, fc=AIR, alpha=0.07, lw=0)
    )
    axes.add_patch(Rectangle((left + 0.45 * width, low), 0.3, 1.6, fc=QUIET, ec=INK))
    axes.add_patch(
        Rectangle((left + 0.45 * width + 0.3, low + 0.65), 0.55 * width + 1.4, 0.3, fc=QUIET, ec=INK)
    )
    axes.add_patch(Rectangle((left + width + 1.7, low + 0.2), 1.1, 1.2, fc="white", ec=INK, lw=1.4))
    axes.text(left + width + 2.25, low + 0.8, "M", ha="center", va="center")
    axes.text(left + 0.2 * width, low + 0.8, "$P_a$, $A_a$", ha="center", va="center", fontsize=9)
    axes.text(left + 0.8 * width, low + 1.25, "$P_b$, $A_b$", ha="center", va="center", fontsize=9)
    arrow(axes, (left + 0.48 * width, low + 2.0), (left + 0.48 * width + 1.3, low + 2.0), text="x, v")
    axes.text(left + width + 0.75, low + 1.1, "$P_{atm}$ on $A_{rod}$", fontsize=7.5, ha="center", color=AIR)


def figure_1() -> Figure:
    """Schematic of the experimental system."""
    figure, axes = canvas(12, 6.2)
    cylinder(axes, 1.2, 3.9)
    box(axes, (4.2, 2.4), "proportional valve", (3.0, 0.9), AIR)
    arrow(axes, (3.4, 2.85), (3.4, 3.3), (1.9, 3.3), (1.9, 3.9), text="A", colour=AIR)
    arrow(axes, (5.0, 2.85), (5.0, 3.3), (6.6, 3.3), (6.6, 3.9), text="B", colour=AIR)
    box(axes, (4.2, 0.7), "compressor, air service unit", (3.4, 0.8), AIR)
    arrow(axes, (4.2, 1.1), (4.2, 1.95), text="$P_s$", colour=AIR)
    box(axes, (9.4, 0.7), "computer, data acquisition", (3.2, 0.8))
    arrow(axes, (7.8, 0.7), (7.0, 0.7), (7.0, 2.4), (5.7, 2.4), text="command")
    arrow(axes, (9.45, 4.1), (9.45, 1.1), text="")
    axes.text(9.6, 2.6, "rack, pinion,\npotentiometer", fontsize=7.5)
    return figure


def figure_2() -> Figure:
    """Five-port valve and actuator."""
    figure, axes = canvas(12, 6.2)
    cylinder(axes, 1.2, 3.9)
    axes.add_patch(Rectangle((1.6, 1.5), 6.4, 1.0, fill=False, ec=INK, lw=1.4))
    for x in (2.3, 4.65, 7.0):
        axes.add_patch(Rectangle((x, 1.55), 0.7, 0.9, fc=QUIET, ec=INK))
    axes.plot([2.3, 7.7], [2.0, 2.0], color=INK, lw=3, alpha=0.4)
    for x, name, up in (
        (3.4, "A", True),
        (6.3, "B", True),
        (2.0, "$P_e$", False),
        (4.1, "$P_s$", False),
        (7.85, "$P_e$", False),
    ):
        ends = ((x, 2.5), (x, 3.9)) if up else ((x, 0.6), (x, 1.5))
        if name == "$P_e$":  # exhaust leaves
            ends = ends[::-1]
        arrow(axes, *ends, text="", colour=AIR)
        axes.text(x + 0.12, 3.1 if up else 0.8, name, fontsize=9, color=AIR)
    axes.text(3.55, 2.75, "$\\dot m_a$: eqs. 1, 3, 5", fontsize=7.5)
    axes.text(6.45, 2.75, "$\\dot m_b$: eqs. 2, 4, 6", fontsize=7.5)
    arrow(axes, (8.2, 2.0), (9.4, 2.0), text="X: spool, W: port width")
    return figure


def figure_3() -> Figure:
    """Algorithm of identification."""
    figure, axes = canvas(7, 8.6)
    steps = (
        "experiment: command, position",
        "choose orders na, nb, nc and delay nk",
        "estimate A, B, C (recursive least squares)",
        "predict k steps, residuals",
        "white? independent of the input?\nheld-out error no worse?",
        "model: audit, export, tune",
    )
    for k, text in enumerate(steps):
        box(axes, (3.2, 8.0 - 1.45 * k), text, (4.6, 0.9))
        if k:
            arrow(
                axes,
                (3.2, 8.0 - 1.45 * (k - 1) - 0.48),
                (3.2, 8.0 - 1.45 * k + 0.48),
                text="yes" if k == 5 else "",
            )
    arrow(axes, (5.5, 2.2), (6.4, 2.2), (6.4, 6.55), (5.55, 6.55), text="no")
    return figure


def figure_4() -> Figure:
    """ARMAX model in the identification loop."""
    figure, axes = canvas(10, 5)
    box(axes, (4, 4), "system")
    box(axes, (4, 2.2), "A, B, C: eq. 12")
    box(axes, (4, 0.6), "recursive estimation")
    arrow(axes, (0.6, 4), (2.85, 4), text="$X_s$(t)")
    arrow(axes, (1.6, 4), (1.6, 2.2), (2.85, 2.2))
    arrow(axes, (5.15, 4), (9.2, 4), text="X(t)")
    arrow(axes, (5.15, 2.2), (7.2, 2.2), text="$\\hat X$(t)")
    arrow(axes, (7.5, 4), (7.5, 2.45))
    node(axes, (7.5, 2.2))
    arrow(axes, (7.5, 1.95), (7.5, 0.6), (5.15, 0.6), text="")
    axes.text(7.7, 1.2, "error, eq. 13", fontsize=8)
    arrow(axes, (4, 1.08), (4, 1.72))
    return figure


def figure_6() -> Figure:
    """Mixed reality: the rig and its model side by side."""
    figure, axes = canvas(11, 5.6)
    box(axes, (3.0, 4.6), "controller")
    box(axes, (7.0, 4.6), "real rig", colour=AIR)
    box(axes, (7.0, 3.0), "simulated model")
    box(axes, (7.0, 1.4), "online ARMAX model")
    box(axes, (3.0, 1.4), "offline optimisation\nof the gains", (2.6, 1.0))
    arrow(axes, (0.4, 4.6), (1.85, 4.6), text="demand")
    arrow(axes, (4.15, 4.6), (5.85, 4.6), text="command")
    arrow(axes, (5.0, 4.6), (5.0, 3.0), (5.85, 3.0))
    arrow(axes, (5.0, 3.0), (5.0, 1.4), (5.85, 1.4))
    arrow(axes, (8.15, 4.6), (10.4, 4.6), text="position")
    arrow(axes, (9.2, 4.6), (9.2, 1.4), (8.15, 1.4))
    arrow(axes, (7.0, 0.92), (7.0, 0.4), (3.0, 0.4), (3.0, 0.88), text="transfer function")
    arrow(axes, (3.0, 1.92), (3.0, 4.12))
    axes.text(3.1, 3.0, "gains", fontsize=8)
    return figure


def figure_7() -> Figure:
    """Block diagram: real system with ARMAX."""
    figure, axes = canvas(11, 4.4)
    box(axes, (1.4, 3.4), "impulses")
    box(axes, (4.4, 3.4), "D/A, valve")
    box(axes, (7.4, 3.4), "cylinder")
    box(axes, (9.9, 3.4), "A/D", (1.4, 0.9))
    for a, b in ((2.55, 3.25), (5.55, 6.25), (8.55, 9.15)):
        arrow(axes, (a, 3.4), (b, 3.4))
    box(axes, (6.0, 1.0), "recursive ARMAX\n(na, nb, nc, nk, λ)", (3.0, 1.1))
    arrow(axes, (2.9, 3.4), (2.9, 1.25), (4.45, 1.25), text="")
    arrow(axes, (9.9, 2.92), (9.9, 1.25), (7.55, 1.25))
    arrow(axes, (4.45, 0.75), (2.6, 0.75), text="A, B, C")
    return figure


def figure_13() -> Figure:
    """The real system in its loop."""
    figure, axes = canvas(12, 3.6)
    node(axes, (1.8, 2.5))
    arrow(axes, (0.3, 2.5), (1.55, 2.5), text="demand")
    box(axes, (3.6, 2.5), "PID with limits")
    box(axes, (6.6, 2.5), "valve")
    box(axes, (9.4, 2.5), "cylinder, load")
    arrow(axes, (2.05, 2.5), (2.45, 2.5))
    arrow(axes, (4.75, 2.5), (5.45, 2.5), text="u")
    arrow(axes, (7.75, 2.5), (8.25, 2.5))
    arrow(axes, (10.55, 2.5), (11.7, 2.5), text="position")
    arrow(axes, (11.1, 2.5), (11.1, 0.8), (7.1, 0.8))
    box(axes, (6.0, 0.8), "potentiometer, A/D")
    arrow(axes, (4.85, 0.8), (1.8, 0.8), (1.8, 2.25))
    return figure


DIAGRAMS: dict[int, Callable[[], Figure]] = {
    1: figure_1,
    2: figure_2,
    3: figure_3,
    4: figure_4,
    6: figure_6,
    7: figure_7,
    13: figure_13,
}
