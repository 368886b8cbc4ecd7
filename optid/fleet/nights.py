"""The jobs of nights: a fit of each rig's first nights, a test of every night, a diagnosis of rigs that changed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from optid.fleet.fleetfile import DATE, RIG, Nightly
from optid.fleet.job import Job, folder_name

DIAGNOSED = 4  # nights that a diagnosis works on, the newest of them held out


def by_rig(jobs: Sequence[Job]) -> dict[str, list[Job]]:
    """The recordings of each rig, a job a night, in the order of their dates."""
    found: dict[str, list[Job]] = {}
    for job in jobs:
        found.setdefault(job.tags[RIG], []).append(job)
    return {rig: sorted(nights, key=lambda job: job.tags[DATE]) for rig, nights in sorted(found.items())}


def fits(rigs: Mapping[str, Sequence[Job]], nightly: Nightly) -> list[Job]:
    """A fit of every rig that has its reference nights, to all of them."""
    found = []
    for rig, nights in rigs.items():
        first = _first(nights, nightly.reference)
        if first:
            tags = {name: value for name, value in nights[0].tags.items() if name != DATE}
            recordings = tuple(one for night in first for one in night.train)
            found.append(replace(nights[0], name=fit_name(rig), command="fit", train=recordings, tags=tags))
    return found


def night_tests(rigs: Mapping[str, Sequence[Job]], nightly: Nightly, out: Path) -> list[Job]:
    """A test of every night of each rig whose fit is there, the reference's nights included."""
    found = []
    for rig, nights in rigs.items():
        fitted = _fitted(rig, out)
        if fitted is not None:
            found += [
                replace(
                    night, command="test", rig=str(fitted), holdout=(), options={"watch": list(nightly.watch)}
                )
                for night in nights
            ]
    return found


def diagnoses(rigs: Mapping[str, Sequence[Job]], told: Sequence[Mapping[str, Any]], out: Path) -> list[Job]:
    """A diagnosis of every reported rig, on the nights up to its first report, starting from its fitted model.

    Where one night alone is new, its own last recording is held out, or the night before it is fitted.
    """
    found = []
    for one in told:
        rig, date = str(one["rig"]), str(one["date"])
        fitted = _fitted(rig, out)
        until = [night for night in rigs.get(rig, ()) if night.tags[DATE] <= date][-DIAGNOSED:]
        if fitted is None or len(until) < 2:
            continue
        *train, held = until
        recordings = tuple(path for night in train for path in night.train)
        job = replace(
            held,
            name=folder_name(f"{rig}.diagnosis-{date}"),
            command="diagnose",
            rig=str(fitted),
            train=recordings,
            holdout=held.train,
            options={},
        )
        found.append(job)
    return found


def fit_name(rig: str) -> str:
    """Name of the row that fits a rig's reference."""
    return folder_name(f"{rig}.fit")


def _first(nights: Sequence[Job], reference: int) -> list[Job]:
    """The nights of the first dates; empty while there are fewer."""
    dates = list(dict.fromkeys(night.tags[DATE] for night in nights))[:reference]
    return [night for night in nights if night.tags[DATE] in dates] if len(dates) == reference else []


def _fitted(rig: str, out: Path) -> Path | None:
    path = out / fit_name(rig) / "rig.toml"
    return path.resolve() if path.is_file() else None
