"""From the folders of rows to one table: a row per rig and run, and what each measured."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from optid.core.document import optional_document
from optid.fleet.fleetfile import DATE, RIG
from optid.fleet.job import Job
from optid.fleet.row import read_run
from optid.fleet.statistics import MEASURES

# What a command's result stands in.
DOCUMENTS = {
    "check": "check.json",
    "simulate": "metrics.json",
    "fit": "fit.json",
    "diagnose": "diagnosis.json",
    "identify": "armax.json",
    "tune": "pid.json",
    "test": "test.json",
}
WIDE = 3.92  # sd in a 95 % interval


def rows_of(out: Path, names: Iterable[str]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Read rows back.

    Parameters
    ----------
    out : Path
        folder of the fleet.
    names : Iterable[str]
        of the rows; those that are not answered are left out.

    Returns
    -------
    tuple[pd.DataFrame, pd.DataFrame]
        One row per run: name, rig, date, job, tags as "tag NAME", outcome, verdict, effects (JSON: name, size and
        interval of each), seconds, memory and digests. And what they measured, columns `MEASURES` with name, job and
        unit.
    """
    runs, measured = [], []
    for name in names:
        run = read_run(out / name)
        if run is None:
            continue
        job = Job.of(run["job"])
        document = _result(out / name, run, job.command)
        rig, date = job.tags.get(RIG, Path(job.rig).stem), job.tags.get(DATE, "")
        runs.append({**_run(name, rig, date, run, job), **_verdict(document, job.command)})
        for quantity, value, sd, unit in _quantities(document, job.command):
            measured.append((rig, date, quantity, value, sd, name, job.command, unit))
    columns = [*MEASURES, "name", "job", "unit"]
    table = pd.DataFrame(measured, columns=columns)
    return pd.DataFrame(runs), table.astype({"value": float, "sd": float})


def _run(name: str, rig: str, date: str, run: Mapping[str, Any], job: Job) -> dict[str, Any]:
    return {
        "name": name,
        "rig": rig,
        "date": date,
        "job": job.command,
        **{f"tag {key}": value for key, value in job.tags.items() if key not in (RIG, DATE)},
        "outcome": run["outcome"],
        "status": run["status"],
        "said": run["said"].splitlines()[-1][:300] if run["said"] else "",
        "seconds": run["seconds"],
        "cpu_seconds": run["cpu_seconds"],
        "memory": run["memory"],
        "attempts": run["attempts"],
        "ended": run["began"],
        "version": run["version"],
        "key": run["key"],
        "rig_sha256": run["inputs"].get(job.rig) or "",
        "inputs": json.dumps(run["inputs"], sort_keys=True),
        "files": json.dumps(run["files"], sort_keys=True),
    }


def _result(place: Path, run: Mapping[str, Any], command: str) -> dict[str, Any]:
    """The row's result; empty where it has none."""
    file = DOCUMENTS[command]
    if file not in run["files"]:
        return {}
    return optional_document(place / file) or {}


def _verdict(document: Mapping[str, Any], command: str) -> dict[str, Any]:
    """Verdict, named effects with their intervals, and the result's own p-value."""
    if command == "diagnose" and document:
        named = {one["effect"]: one["parameters"] for one in document["findings"] if one["effect"]}
        return {
            "verdict": document["verdict"],
            "effects": json.dumps(named, sort_keys=True),
            "p_value": document.get("test", {}).get("p_value"),
        }
    word = {"fit": "outcome", "check": "summary"}.get(command)
    return {"verdict": str(document.get(word, "")) if word else "", "effects": "{}", "p_value": None}


def _quantities(document: Mapping[str, Any], command: str) -> Iterator[tuple[str, float, float, str]]:
    """Quantity, SI value, sd and unit."""
    if command == "test":
        for name, one in document.get("quantities", {}).items():
            yield name, one["value"], float("nan") if one["sd"] is None else one["sd"], one["unit"]
    elif command == "fit":
        for name, one in document.get("parameters", {}).items():
            yield name, _number(one["value"]), _sd(one["ci95"]), one["unit"]
    elif command == "diagnose" and document:
        for name, one in document["improved"]["parameters"].items():
            yield name, _number(one["value"]), _sd(one["ci95"]), one["unit"]
        for finding in document["findings"]:
            for name, one in finding["parameters"].items() if finding["effect"] else ():
                yield f"{finding['effect']}.{name}", _number(one["value"]), _sd(one["ci95"]), one["unit"]


def _number(value: Any) -> float:
    return float("nan") if value is None else float(value)


def _sd(interval: Any) -> float:
    ends = [_number(end) for end in interval] if interval else [float("nan")] * 2
    return (ends[1] - ends[0]) / WIDE


def wide(runs: pd.DataFrame, measured: pd.DataFrame) -> pd.DataFrame:
    """The runs with a column for every quantity and its 95 % interval: NAME, "NAME low", "NAME high"."""
    if runs.empty or measured.empty:
        return runs
    half = 0.5 * WIDE * measured["sd"]
    long = measured.assign(low=measured["value"] - half, high=measured["value"] + half)
    parts = []
    for column, end in (("value", ""), ("low", " low"), ("high", " high")):
        part = long.pivot_table(index="name", columns="quantity", values=column, dropna=False)
        parts.append(part.add_suffix(end))
    table = pd.concat(parts, axis=1)
    return runs.merge(table[sorted(table.columns)], left_on="name", right_index=True, how="left")
