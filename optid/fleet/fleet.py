"""A fleet from its file to its result: jobs, runs, table, statistics."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import TYPE_CHECKING, Any

from optid.errors import InputError
from optid.fleet.fleetfile import Fleet, Nightly, read_fleet
from optid.fleet.job import Job
from optid.fleet.nights import by_rig, diagnoses, fits, night_tests
from optid.fleet.running import RowResult, run_jobs
from optid.report.bundle import write_library

if TYPE_CHECKING:
    from optid.results.fleet import FleetResult

PLAN = ".plan.json"

Progress = Callable[[float, str], None]


def run(
    jobs: str | Path | Fleet | Iterable[Job],
    out: str | Path = "out/fleet",
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    progress: Progress = lambda share, words: None,
) -> FleetResult:
    """Answer every row that is missing or changed, and report on the whole fleet.

    Parameters
    ----------
    jobs : str | Path | Fleet | Iterable[Job]
        a fleet file, what `read_fleet` made of one, or jobs.
    out : str | Path
        folder of the results, in which each row has one; workers elsewhere must see it under the same path.
    executor : Executor | None
        any of `concurrent.futures`: Dask's, mpi4py's, and submitit's; jobs travel to it as paths and plain data. When
        absent they run here.
    workers : int | None
        rows at a time without an executor; as many as cores when absent.
    progress : Progress
        called with the share done and a few words.

    Returns
    -------
    FleetResult
        Not written yet but for the rows; `save(out)` writes it.

    Raises
    ------
    InputError
        the fleet file is wrong, or two rows have the same name.
    JobError
        the executor was lost; rows that are answered stay.
    """
    fleet = _fleet(jobs)
    place = Path(out).resolve()
    place.mkdir(parents=True, exist_ok=True)
    write_library(place)
    names: list[str] = []

    def go(some: Sequence[Job], share: tuple[float, float]) -> None:
        names.extend(job.name for job in some)
        _write_plan(place, names, fleet)
        count = iter(range(1, len(some) + 1))

        def ended(ran: RowResult) -> None:
            done = next(count, len(some)) / max(len(some), 1)
            progress(share[0] + (share[1] - share[0]) * done, f"{ran.name}: {ran.outcome}")

        run_jobs(some, place, executor=executor, workers=workers, report=ended)

    if fleet.nightly is None:
        go(fleet.jobs, (0.0, 0.98))
    else:
        _follow(fleet, fleet.nightly, place, go, names)
    progress(0.99, "statistics of the fleet")
    from optid.fleet.conclude import concluded  # the tables and statistics: not needed while rows run

    return concluded(fleet, place, names)


def _follow(
    fleet: Fleet,
    nightly: Nightly,
    out: Path,
    go: Callable[[Sequence[Job], tuple[float, float]], None],
    names: list[str],
) -> None:
    """Fit the reference, test each night, and diagnose the rigs that changed."""
    from optid.fleet.conclude import concluded

    rigs = by_rig(fleet.jobs)
    go(fits(rigs, nightly), (0.0, 0.3))
    go(night_tests(rigs, nightly, out), (0.3, 0.7))
    if nightly.diagnose:
        go(diagnoses(rigs, concluded(fleet, out, names).told, out), (0.7, 0.98))


def read_names(out: Path) -> tuple[list[str], Fleet, float]:
    """The plan of a fleet's folder: names of rows, settings of their statistics, and start of the run (s, epoch).

    Raises
    ------
    InputError
        no fleet was run into it.
    """
    try:
        plan = json.loads((out / PLAN).read_text(encoding="utf-8"))
        nightly = None if plan["nightly"] is None else Nightly(reference=int(plan["nightly"]))
        fleet = Fleet((), nightly, float(plan["level"]), str(plan["siblings"]))
        return [str(name) for name in plan["rows"]], fleet, float(plan["began"])
    except (OSError, ValueError, KeyError, TypeError):
        raise InputError(
            "it holds no results of a fleet", where=out, expected="a folder that optid fleet wrote into"
        ) from None


def conclude(out: str | Path) -> FleetResult:
    """The result of the rows in a fleet's folder that are finished.

    Parameters
    ----------
    out : str | Path
        folder of the fleet.

    Returns
    -------
    FleetResult
        outcomes, changed rigs and tables of the finished rows.

    Raises
    ------
    InputError
        no fleet was run into it.
    """
    from optid.fleet.conclude import concluded

    place = Path(out).resolve()
    names, fleet, _ = read_names(place)
    return concluded(fleet, place, names)


def _fleet(jobs: str | Path | Fleet | Iterable[Job]) -> Fleet:
    if isinstance(jobs, (str, Path)):
        return read_fleet(jobs)
    return jobs if isinstance(jobs, Fleet) else Fleet(tuple(jobs))


def _write_plan(out: Path, names: list[str], fleet: Fleet) -> None:
    plan: dict[str, Any] = {
        "rows": names,
        "began": time.time(),
        "level": fleet.level,
        "siblings": fleet.siblings,
        "nightly": fleet.nightly.reference if fleet.nightly is not None else None,
    }
    fresh = out / f"{PLAN}.new"
    fresh.write_text(json.dumps(plan), encoding="utf-8")
    fresh.replace(out / PLAN)
