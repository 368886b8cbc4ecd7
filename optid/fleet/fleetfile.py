"""`fleet.toml`: jobs, rigs and recordings of a fleet."""

from __future__ import annotations

import hashlib
import itertools
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from optid.core.document import parsed_toml, read_bounded
from optid.errors import InputError, nearest
from optid.fleet.job import Job, Limits, folder_name

MOST = 64 * 2**20  # bytes of a fleet file
LEVEL = 0.05  # expected share of false alarms
REFERENCE = 7  # nights that a rig's fit and its scatter are taken from: a week
SEVERAL = ";"  # between the recordings of a cell
DATE, RIG = "date", "rig"  # tags that the fleet as a whole goes by
# Wear of a servo-pneumatic axis: what leaks, sticks, gets slack, clogs or drifts.
WATCHED = (
    "ambient_leakage",
    "cross_leakage",
    "valve_deadband",
    "valve_offset",
    "valve_lag",
    "stribeck_friction",
    "sensor_backlash",
    "supply_droop",
)
_TOP = ("defaults", "rows", "table", "glob", "nightly", "statistics")
_ROW = ("name", "job", "rig", "train", "holdout", "tags", "options")
_BOUNDS = tuple(one.name for one in fields(Limits))


@dataclass(frozen=True)
class Nightly:
    """What is done with each night's recordings.

    Attributes
    ----------
    reference : int
        nights, the first of each rig, that its model is fitted to.
    watch : tuple[str, ...]
        effects whose sizes are followed, of those that the rig's plant admits.
    diagnose : bool
        diagnose a rig once its test says that something changed.
    """

    reference: int = REFERENCE
    watch: tuple[str, ...] = WATCHED
    diagnose: bool = True


@dataclass(frozen=True)
class Fleet:
    """A parsed fleet file.

    Attributes
    ----------
    jobs : tuple[Job, ...]
        a row each, names unique.
    nightly : Nightly | None
        when nights are followed; the jobs are then those recordings, one a rig and night.
    level : float
        expected share of false alarms among the rigs reported.
    siblings : str
        tag whose equal values make rigs siblings; all are where it is empty.
    """

    jobs: tuple[Job, ...]
    nightly: Nightly | None = None
    level: float = LEVEL
    siblings: str = ""


def read_fleet(path: str | Path) -> Fleet:
    """Read a fleet file.

    Parameters
    ----------
    path : str | Path
        TOML; paths in it are relative to its folder.

    Returns
    -------
    Fleet
        its jobs and settings.

    Raises
    ------
    InputError
        cannot be read, or an entry is not valid; names file and field, what was found and expected.
    """
    path = Path(path)
    content = _toml(path)
    _known(content, _TOP, path, "")
    defaults = _table(content, "defaults", path)
    _known(defaults, ("job", "options", *_BOUNDS), path, "defaults.")
    rows = [*_stated(content, path), *_tabled(content, path), *_globbed(content, path)]
    if not rows:
        raise InputError("no rows", where=path, expected="[[rows]], [table] or [glob]")
    jobs = [_job({**defaults, **row}, field, path) for field, row in rows]
    told = _table(content, "statistics", path)
    _known(told, ("level", "siblings"), path, "statistics.")
    level = told.get("level", LEVEL)
    if not isinstance(level, float) or not 0.0 < level < 1.0:
        raise InputError(
            f"{level}", where=path, field="statistics.level", expected="a number between 0 and 1"
        )
    nightly = _nightly(content["nightly"], jobs, path) if "nightly" in content else None
    return Fleet(tuple(_named(jobs)), nightly, level, str(told.get("siblings", "")))


def _toml(path: Path) -> Mapping[str, Any]:
    try:
        return parsed_toml(read_bounded(path, MOST).decode("utf-8-sig"))
    except FileNotFoundError:
        raise InputError("no such file", where=path, expected="a fleet file (TOML)") from None
    except (OSError, ValueError) as error:
        raise InputError(f"cannot be read ({error})", where=path, expected="a fleet file (TOML)") from None


def _known(table: Mapping[str, Any], names: Iterable[str], path: Path, field: str) -> None:
    valid = list(names)
    for key in table:
        if key not in valid:
            raise InputError(f'unknown key "{key}"', where=path, field=field + key, hint=nearest(key, valid))


def _table(table: Mapping[str, Any], key: str, path: Path) -> Mapping[str, Any]:
    value = table.get(key, {})
    if not isinstance(value, dict):
        raise InputError(f"found {value!r}", where=path, field=key, expected="a table")
    return value


def _stated(content: Mapping[str, Any], path: Path) -> list[tuple[str, dict[str, Any]]]:
    rows = content.get("rows", [])
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise InputError("it is not a list of tables", where=path, field="rows", expected="[[rows]]")
    for number, row in enumerate(rows, 1):
        _known(row, (*_ROW, *_BOUNDS), path, f"rows {number}: ")
    return [(f"rows {number}", row) for number, row in enumerate(rows, 1)]


def _tabled(content: Mapping[str, Any], path: Path) -> list[tuple[str, dict[str, Any]]]:
    """Rows of a CSV or Parquet file: columns rig, train and holdout; every other one is a tag."""
    if "table" not in content:
        return []
    table = _table(content, "table", path)
    _known(table, ("file",), path, "table.")
    file = path.parent / _text(table, "file", "table.file", path)
    import pandas as pd

    try:
        frame = pd.read_parquet(file) if file.suffix == ".parquet" else pd.read_csv(file, dtype=str)
    except FileNotFoundError:
        raise InputError("no such file", where=path, field="table.file", expected=f"{file}") from None
    except (OSError, ValueError, ImportError) as error:
        raise InputError(f"cannot be read ({error})", where=file, expected="a CSV or Parquet table") from None
    for name in ("rig", "train"):
        if name not in frame:
            raise InputError(
                f'no column "{name}"', where=file, expected="rig, train, holdout; the rest are tags"
            )
    rows = []
    for number, line in enumerate(frame.astype(object).where(frame.notna(), "").to_dict("records"), 1):
        row: dict[str, Any] = {name: line[name] for name in ("name", "job", "rig") if line.get(name)}
        for name in ("train", "holdout"):
            row[name] = [one.strip() for one in str(line.get(name, "")).split(SEVERAL) if one.strip()]
        row["tags"] = {str(k): str(v) for k, v in line.items() if k not in _ROW and v != ""}
        rows.append((f"{file.name} row {number}", row))
    return rows


def _globbed(content: Mapping[str, Any], path: Path) -> list[tuple[str, dict[str, Any]]]:
    """Rows of the files that a pattern finds: one for each set of its {names}, which are the row's tags."""
    if "glob" not in content:
        return []
    table = _table(content, "glob", path)
    _known(table, ("recordings", "rig", "tags"), path, "glob.")
    pattern, rig = (_text(table, key, f"glob.{key}", path) for key in ("recordings", "rig"))
    names = re.findall(r"\{(\w+)\}", pattern)
    try:
        told = re.compile(_expression(pattern))
        asked = [name for name in re.findall(r"\{(\w+)\}", rig) if name not in names]
    except re.error as error:
        raise InputError(
            f"{error}", where=path, field="glob.recordings", expected="names in braces"
        ) from None
    if asked:
        raise InputError(f"{{{asked[0]}}}", where=path, field="glob.rig", expected=f"names of {pattern}")
    found: dict[tuple[tuple[str, str], ...], list[str]] = {}
    for file in sorted(path.parent.glob(re.sub(r"\{\w+\}", "*", pattern))):
        matched = told.fullmatch(file.relative_to(path.parent).as_posix())
        if matched is not None:
            found.setdefault(tuple(sorted(matched.groupdict().items())), []).append(str(file))
    more = {str(k): str(v) for k, v in _table(table, "tags", path).items()}
    return [
        ("glob", {"rig": rig.format(**dict(tags)), "train": files, "tags": {**more, **dict(tags)}})
        for tags, files in found.items()
    ]


def _expression(pattern: str) -> str:
    """A regular expression for a pattern with {name}, * and ? in it; a name stands for the same text throughout."""
    seen: set[str] = set()
    parts = []
    for part in re.split(r"(\{\w+\}|\*\*/|\*|\?)", pattern):
        name = part[1:-1]
        if part.startswith("{") and part.endswith("}"):
            parts.append(f"(?P={name})" if name in seen else f"(?P<{name}>[^/]+?)")
            seen.add(name)
        else:
            parts.append({"**/": "(?:.*/)?", "*": "[^/]*", "?": "[^/]"}.get(part, re.escape(part)))
    return "".join(parts)


def _text(table: Mapping[str, Any], key: str, field: str, path: Path) -> str:
    value = table.get(key)
    if not isinstance(value, str) or not value.strip() or "\0" in value:
        found = "missing" if value is None else f"found {value!r}"
        raise InputError(found, where=path, field=field, expected="a text")
    return value


def _texts(row: Mapping[str, Any], key: str, field: str, path: Path) -> tuple[str, ...]:
    """Paths, as seen from the fleet file's folder."""
    value = row.get(key, [])
    if not isinstance(value, list) or not all(
        isinstance(one, str) and one and "\0" not in one for one in value
    ):
        raise InputError(f"found {value!r}", where=path, field=f"{field}: {key}", expected="a list of paths")
    return tuple(str((path.parent / one).resolve()) for one in value)


def _job(row: Mapping[str, Any], field: str, path: Path) -> Job:
    rig = str((path.parent / _text(row, "rig", f"{field}: rig", path)).resolve())
    train, holdout = _texts(row, "train", field, path), _texts(row, "holdout", field, path)
    if not train:
        raise InputError("no recording", where=path, field=f"{field}: train", expected="a list of paths")
    tags = {str(k): str(v) for k, v in _table(row, "tags", path).items()}
    tags.setdefault(RIG, Path(rig).stem)
    command = row.get("job", "check")
    name = folder_name(row.get("name") or "-".join(tags[k] for k in (RIG, DATE) if tags.get(k)))
    try:
        options = dict(_table(row, "options", path))
        return Job(name, command, rig, train, holdout, tags, options, _limits(row, field, path))
    except InputError as error:
        raise InputError(f"{error}", where=path, field=field) from None


def _limits(row: Mapping[str, Any], field: str, path: Path) -> Limits:
    given = {name: row[name] for name in _BOUNDS if name in row}
    if isinstance(given.get("memory"), str):
        number, _, unit = given["memory"].partition(" ")
        sizes = {"MB": 1e6, "GB": 1e9, "MiB": 2**20, "GiB": 2**30}
        if unit not in sizes or not re.fullmatch(r"\d+(\.\d+)?", number):
            raise InputError(
                f'"{given["memory"]}"', where=path, field=f"{field}: memory", expected='"2 GB", or bytes'
            )
        given["memory"] = int(float(number) * sizes[unit])
    for name, value in given.items():
        whole = name in ("threads", "memory", "retries")
        least = 0 if name == "retries" else 1 if whole else 0.0
        if isinstance(value, bool) or not isinstance(value, int if whole else int | float) or value < least:
            kind = "a whole number" if whole else "seconds"
            raise InputError(f"found {value!r}", where=path, field=f"{field}: {name}", expected=kind)
    if "time_limit" in given and "deadline" not in given:
        given["deadline"] = 4.0 * given["time_limit"] + 60.0
    return Limits(**given)


def _nightly(table: Any, jobs: Sequence[Job], path: Path) -> Nightly:
    if not isinstance(table, dict):
        raise InputError(f"found {table!r}", where=path, field="nightly", expected="a table")
    _known(table, ("reference", "watch", "diagnose"), path, "nightly.")
    reference, watch = table.get("reference", REFERENCE), table.get("watch", list(WATCHED))
    if not isinstance(reference, int) or reference < 3:
        raise InputError(
            f"{reference}",
            where=path,
            field="nightly.reference",
            expected="at least 3 nights: two give no spread",
        )
    if not isinstance(watch, list) or not all(isinstance(one, str) for one in watch):
        raise InputError(f"found {watch!r}", where=path, field="nightly.watch", expected="a list of effects")
    for job in jobs:
        if not job.tags.get(DATE):
            raise InputError("no date", where=path, field=job.name, expected='tags = { date = "2026-10-03" }')
    return Nightly(reference, tuple(watch), bool(table.get("diagnose", True)))


def _named(jobs: Sequence[Job]) -> list[Job]:
    """Each with a name of its own: those that share one are told apart by what they work on."""
    count: dict[str, int] = {}
    for job in jobs:
        count[job.name] = count.get(job.name, 0) + 1
    named = []
    for job in jobs:
        if count[job.name] > 1:
            what = repr((job.command, job.rig, job.train, job.holdout, sorted(job.options.items())))
            digest = hashlib.sha256(what.encode("utf-8")).hexdigest()[:8]
            job = replace(job, name=folder_name(f"{job.name[:100]}-{digest}"))
        named.append(job)
    for one, other in itertools.pairwise(sorted(named, key=lambda job: job.name)):
        if one.name == other.name:
            raise InputError("two rows are the same", where=one.name, field="rows", expected="different rows")
    return named
