"""Common parts of pages of predictions: the table of scores, and each recording with its figures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from optid.report import prediction_figures as figures
from optid.report.interactive import interactive
from optid.results.words import error, percent

if TYPE_CHECKING:
    import pandas as pd

    from optid.results.result import Result


def score_table(window: Mapping[str, Any], free_run: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Channel, fit and error of windows, fit and error of the free run."""
    return [
        (
            role.replace("_", " "),
            percent(score["fit_percent"]),
            error(score["rmse"], score["unit"]),
            percent(free_run[role]["fit_percent"]),
            error(free_run[role]["rmse"], score["unit"]),
        )
        for role, score in window.items()
    ]


def exhibits(result: Result) -> list[dict[str, Any]]:
    """The recordings of a result with their figures, for a template."""
    about = result.document["about"]
    noise = {role: entry["sd"] for role, entry in result.document.get("noise", {}).items()} or about[
        "sensor_noise"
    ]
    return [
        {**entry, "channels": _channels(result, entry["name"], about, noise)} for entry in about["recordings"]
    ]


def _channels(
    result: Result, name: str, about: Mapping[str, Any], noise: Mapping[str, Any]
) -> list[dict[str, Any]]:
    frame, inputs = (part(result.tables[table], name) for table in ("prediction", "inputs"))
    units = {**about["outputs"], **about["channel_inputs"]}
    found = []
    for role, unit in about["outputs"].items():
        if frame[role].notna().any():
            drawn = figures.overlay(frame, inputs, role, units, about["horizon"], noise.get(role))
            left = figures.residuals(frame, role, unit)
            found.append(
                {
                    "role": role,
                    "overlay": interactive(drawn, f"{name} {role}"),
                    "residuals": interactive(left, f"{name} {role} residuals"),
                }
            )
    return found


def part(frame: pd.DataFrame, name: str) -> pd.DataFrame:
    """The rows of one recording."""
    return frame[frame["recording"] == name]


def plotted(result: Result, axes: Any, use: str) -> None:
    """The first output of the last recording of a use on given axes."""
    about = result.document["about"]
    entries = [entry for entry in about["recordings"] if entry["use"] == use] or about["recordings"]
    frame = part(result.tables["prediction"], entries[-1]["name"])
    role = next(role for role in about["outputs"] if frame[role].notna().any())
    figures.predictions(axes, frame, role, about["outputs"][role], about["horizon"])
    axes.set_xlabel(f"time of {entries[-1]['name']} (s)")


def paths(result: Result, use: str) -> list[str]:
    """The recordings of a use, as on a command line."""
    return [entry["path"] for entry in result.document["about"]["recordings"] if entry["use"] == use]
