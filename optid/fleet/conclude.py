"""The conclusions from all rows of a fleet: the document and the tables of its result."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from optid.core.version import version
from optid.fleet.fleetfile import REFERENCE, Fleet
from optid.fleet.statistics.changes import Changes, changes
from optid.fleet.statistics.siblings import levels, pooled, unlike
from optid.fleet.statistics.trends import trends
from optid.fleet.table import rows_of, wide
from optid.results.fleet import FleetResult


def concluded(fleet: Fleet, out: Path, names: list[str]) -> FleetResult:
    """The fleet's result, from the folders of its rows.

    Parameters
    ----------
    fleet : Fleet
        what was asked.
    out : Path
        folder of the fleet.
    names : list[str]
        of all rows, answered or not.
    """
    runs, measured = rows_of(out, names)
    reference = fleet.nightly.reference if fleet.nightly is not None else REFERENCE
    followed = _followed(measured)
    found = changes(followed, reference, fleet.level)
    told = _described(found.told, measured)
    dated = followed[followed["date"] != ""]
    trend = trends(dated) if not dated.empty else trends(followed.head(0))
    odd, shared = _kin(followed, runs, fleet, reference)
    table = wide(runs, measured)
    if not found.nights.empty and not table.empty:
        table = table.merge(found.nights[["rig", "date", "p", "p_rig", "q"]], on=["rig", "date"], how="left")
    outcomes = {str(k): int(v) for k, v in runs["outcome"].value_counts().items()} if not runs.empty else {}
    rigs = int(runs["rig"].nunique()) if not runs.empty else 0
    document = {
        "schema": FleetResult.SCHEMA,
        "version": version(),
        "command": "fleet",
        "inputs": {},
        "rows": len(names),
        "rigs": rigs,
        "outcomes": outcomes,
        "failed": _failed(runs),
        "level": fleet.level,
        "reference": reference,
        "told": told,
        "sentences": _sentences(told, rigs),
        "unlike": _records(odd[odd["told"].astype(bool)]) if not odd.empty else [],
        "pooled": _records(shared),
    }
    tables = {"rows": table, "nights": found.nights, "trends": trend, "measures": measured, "t": _long(found)}
    return FleetResult(document, {name: one for name, one in tables.items() if not one.empty})


def _followed(measured: pd.DataFrame) -> pd.DataFrame:
    """The measures that are compared: nights' tests, or fits where there are none."""
    tests = measured[measured["job"] == "test"]
    return measured[measured["job"] == "fit"] if tests.empty else tests


def _kin(
    followed: pd.DataFrame, runs: pd.DataFrame, fleet: Fleet, reference: int
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Rigs that differ from their siblings, and what siblings share, over all groups of siblings."""
    column = f"tag {fleet.siblings}"
    kind = runs.groupby("rig")[column].first().to_dict() if fleet.siblings and column in runs else {}
    first = levels(followed, reference)
    group = first["rig"].map(lambda rig: kind.get(rig, "")) if not first.empty else pd.Series(dtype=str)
    odd, shared = [], []
    for name, some in first.groupby(group, sort=True) if not first.empty else ():
        odd.append(unlike(some, fleet.level).assign(siblings=name))
        shared.append(pooled(some).assign(siblings=name))
    empty = pd.DataFrame()
    return (
        (pd.concat(odd, ignore_index=True), pd.concat(shared, ignore_index=True)) if odd else (empty, empty)
    )


def _described(told: pd.DataFrame, measured: pd.DataFrame) -> list[dict[str, Any]]:
    """The reported rigs, with the direction of the most significant quantity, and its unit."""
    units = dict(zip(measured["quantity"], measured["unit"], strict=True))
    return [
        {
            **{name: row[name] for name in ("rig", "date", "quantity", "t", "p_rig", "q", "shift", "sd")},
            "way": "grows" if row["shift"] > 0 else "falls",
            "unit": units.get(row["quantity"], "1"),
        }
        for row in told.to_dict("records")
    ]


def _sentences(told: list[dict[str, Any]], rigs: int) -> list[str]:
    """ "valve_deadband.width grows on 14 of 200 rigs, first seen on 2026-10-03"."""
    groups: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for one in told:
        groups.setdefault((one["quantity"], one["way"]), []).append(one)
    return [
        f"{quantity.replace('_', ' ')} {way} on {len(some)} of {rigs} rigs, first seen on "
        f"{min(one['date'] for one in some)}: {', '.join(sorted(one['rig'] for one in some))}"
        for (quantity, way), some in sorted(groups.items(), key=lambda item: -len(item[1]))
    ]


def _failed(runs: pd.DataFrame) -> list[dict[str, str]]:
    if runs.empty:
        return []
    bad = runs[runs["outcome"] != "done"]
    return [{"name": r["name"], "outcome": r["outcome"], "said": r["said"]} for r in bad.to_dict("records")]


def _records(table: pd.DataFrame) -> list[Mapping[str, Any]]:
    """Rows for JSON: values that are not finite are null."""
    return [
        {str(k): (None if isinstance(v, float) and not pd.notna(v) else _plain(v)) for k, v in row.items()}
        for row in table.to_dict("records")
    ]


def _plain(value: Any) -> Any:
    return value.item() if hasattr(value, "item") else value


def _long(found: Changes) -> pd.DataFrame:
    if found.t.empty:
        return found.t
    return found.t.rename_axis(index="rig").reset_index()
