"""The view of a fit."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from optid.core.quantity import plain, quantity
from optid.report import prediction_figures as figures
from optid.report.figures import STYLE
from optid.report.interactive import interactive
from optid.report.shell import render
from optid.report.views.canvas import axes_or_new
from optid.report.views.predictions import exhibits, paths, plotted, score_table
from optid.results.fit import FitResult
from optid.results.words import error, parameter_rows, percent


def plot(result: FitResult, axes: Axes | None = None) -> Axes:
    """Measured and predicted first output, of the last held-out recording where there is one."""
    drawn = axes_or_new(axes)
    plotted(result, drawn, "held out")
    return drawn


def page(result: FitResult) -> str:
    """The report of `optid fit`."""
    d, about = result.document, result.document["about"]
    frame = result.tables["nodes"]
    tables = [
        (use, score_table(d[key], d[f"{key}_free_run"]))
        for use, key in (("training", "train"), ("held out", "holdout"))
        if d[key]
    ]
    train = " ".join(paths(result, "training"))
    held = "".join(f" --holdout {name}" for name in paths(result, "held out") or ["OTHER"])
    return render(
        "prediction.html.j2",
        f"{about['rig']}: fit",
        about=about,
        lead=f"{result.outcome.value} {_in_short(result)}",
        seconds=d["seconds"],
        tables=tables,
        fit=_parameters(result),
        ties=d["ties"],
        profiles=_profiles(result),
        nodes=interactive(figures.nodes(frame), "nodes") if len(frame) else None,
        sound=(int(frame["sound"].sum()), len(frame)),
        exhibits=exhibits(result),
        unknowns=about["unknowns"],
        next_command=f"optid diagnose {about['rig_file']} {train}{held} --out out/diagnosis",
    )


def _in_short(result: FitResult) -> str:
    """The main result: how well it predicts held-out data, or the training data where none were held out."""
    scores = result.holdout or result.train
    what = "held-out data" if result.holdout else "the data it was fitted to"
    said = ", ".join(
        f"{role.replace('_', ' ')} to {error(s['rmse'], s['unit'])} rms ({percent(s['fit_percent'])})"
        for role, s in scores.items()
    )
    return f"{result.document['horizon']:g} s ahead on {what}: {said}."


def _parameters(result: FitResult) -> dict[str, list[dict[str, str]]]:
    """Rows of the requested parameters, and of the settings of the equations that were fitted with them."""
    every, asked = result.document["parameters"], result.document["asked"]
    rows = dict(zip(every, parameter_rows(every, result.marks), strict=True))
    found: dict[str, list[dict[str, str]]] = {"asked": [], "settings": []}
    for name, entry in every.items():
        _, value, interval, mark = rows[name]
        known = not mark and None not in entry["ci95"]
        share = (
            100 * (entry["ci95"][1] - entry["ci95"][0]) / 2 / abs(entry["value"])
            if known and entry["value"]
            else None
        )
        row = {
            "name": name.replace("_", " "),
            "value": value,
            "interval": interval if known or name in asked else "–",
            "share": "" if share is None else f"{plain(share, 2)} %",
            "start": quantity(entry["start"], entry["unit"], 5),
            "mark": mark,
        }
        found["asked" if name in asked else "settings"].append(row)
    return found


def _profiles(result: FitResult) -> list[tuple[str, Any]]:
    found = []
    for name, entry in result.document["profiles"].items():
        with mpl.rc_context(STYLE):
            figure = Figure(figsize=(9.2, 2.7), layout="constrained")
            figures.profile(figure.subplots(), result.tables[f"profile {name}"], entry, name)
        found.append((entry["words"], interactive(figure, f"profile of {name}")))
    return found
