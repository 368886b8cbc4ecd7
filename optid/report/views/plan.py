"""The view of a plan."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes

from optid.core.quantity import quantity
from optid.report.interactive import interactive
from optid.report.plan_figures import experiment, positions
from optid.report.shell import render
from optid.report.views.canvas import axes_or_new
from optid.results.plan import EXPERIMENT, PlanResult


def plot(result: PlanResult, axes: Axes | None = None) -> Axes:
    """Reference and predicted position."""
    drawn = axes_or_new(axes)
    positions(drawn, result.tables["experiment"], result.document)
    drawn.set_xlabel("time (s)")
    return drawn


def page(result: PlanResult) -> str:
    """The report of `optid plan`."""
    d, about = result.document, result.document["about"]
    file = f"{about.get('folder', 'out/plan')}/{EXPERIMENT}"
    return render(
        "plan.html.j2",
        f"{d['rig']}: the next experiment",
        d=d,
        lead=lead(d),
        figure=interactive(experiment(result.tables["experiment"], d), "experiment"),
        rivals=[(entry["effect"], _smallest(entry), entry["law"]) for entry in d["rivals"]],
        gains={name: value for name, value in d["gains"].items() if value},
        next_command=f"optid live {about['rig_file']} --reference {file} --seconds {d['seconds']:g} --out out/run",
    )


def lead(d: Mapping[str, Any]) -> str:
    """What the experiment achieves, in one or two sentences."""
    hard = [row for row in d["pairs"] if row["sd"] < d["needed_sd"]]
    what = "shows the effect" if len(d["rivals"]) == 1 else "distinguishes every pair"
    at = "At the smallest size worth a name"
    if not hard:
        return f"{at}, {d['seconds']:g} s {what} with at most one error in a hundred."
    first = hard[0]
    pair = f"{first['there']} from {first['instead'] or 'nothing missing'}"
    if any(row["seconds_needed"] is None for row in hard):
        return f"Nothing that this rig measures distinguishes {pair} at the smallest size worth a name."
    return (
        f"{at}, {d['seconds']:g} s are not enough for at most one error in a hundred: "
        f"to tell {pair} takes {first['seconds_needed']:.3g} s of it."
    )


def _smallest(entry: Mapping[str, Any]) -> str:
    sizes = entry["smallest"].items()
    return ", ".join(f"{name.replace('_', ' ')} {quantity(q['value'], q['unit'])}" for name, q in sizes)
