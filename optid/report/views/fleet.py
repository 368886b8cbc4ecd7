"""The view of a fleet."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes

from optid.report import fleet_figures as figures
from optid.report.bundle import BUNDLE
from optid.report.bundle import write_library as write_library
from optid.report.interactive import interactive
from optid.report.shell import render
from optid.report.views.canvas import axes_or_new
from optid.results.fleet import FleetResult

LISTED = 2000  # rows that the page lists; the table holds all
DRAWN = 24  # rigs whose trend is drawn


def plot(result: FleetResult, axes: Axes | None = None) -> Axes:
    """Rigs against quantities on the last night, or the outcomes of the rows."""
    drawn = axes_or_new(axes)
    if "t" in result.tables:
        figures.heatmap(drawn, result.tables["t"], [one["rig"] for one in result.told])
    else:
        figures.outcomes(drawn, result.document["outcomes"])
    return drawn


def page(result: FleetResult) -> str:
    """The report of `optid fleet`."""
    d = result.document
    overview = (
        figures.overview(result.tables["t"], [one["rig"] for one in d["told"]])
        if "t" in result.tables
        else None
    )
    return render(
        "fleet.html.j2",
        "Fleet",
        d=d,
        lead=result.summary().splitlines()[0],
        overview=None if overview is None else interactive(overview, "rigs against quantities"),
        nights=interactive(figures.discoveries(result.tables["nights"], d["level"]), "rigs reported by night")
        if "nights" in result.tables
        else None,
        told=[_told(result, one) for one in d["told"][:DRAWN]],
        rows=_rows(result),
        total=d["rows"],
        shared_library=BUNDLE,
    )


def _told(result: FleetResult, one: dict[str, Any]) -> dict[str, Any]:
    measures, trends = result.tables["measures"], result.tables.get("trends")
    mine = measures[(measures["rig"] == one["rig"]) & (measures["quantity"] == one["quantity"])]
    trend = None
    if trends is not None:
        found = trends[(trends["rig"] == one["rig"]) & (trends["quantity"] == one["quantity"])]
        trend = found.iloc[0].to_dict() if len(found) else None
    drawn = figures.trend(mine, one["quantity"], one["unit"], one["date"], result.document["reference"])
    return {**one, "trend": trend, "figure": interactive(drawn, f"{one['rig']} {one['quantity']}")}


def _rows(result: FleetResult) -> list[dict[str, Any]]:
    """Rows in order of importance: failed ones, then diagnoses and fits, then the newest."""
    frame = result.to_frame()
    if frame.empty:
        return []
    rank = frame["job"].map({"diagnose": 0, "fit": 1}).fillna(2)
    order = frame.assign(_bad=frame["outcome"] == "done", _rank=rank).sort_values(
        ["_bad", "_rank", "date"], ascending=[True, True, False]
    )
    columns = ["name", "rig", "date", "job", "outcome", "verdict", "effects", "said", "cpu_seconds"]
    return [{str(k): v for k, v in row.items()} for row in order[columns].head(LISTED).to_dict("records")]
