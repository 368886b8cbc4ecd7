"""Running a method on every case of a draw: a process each, bounded as a fleet's are, on all cores, resuming."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from optid.fleet.job import Limits
from optid.fleet.process import Outcome, supervise
from studies.trial.record import HELD_OUT, TRAIN

ROOT = Path(__file__).parents[2]
METHODS = {
    "diagnose": ("-m", "optid.cli", "diagnose"),
    "exhaustive": (str(ROOT / "studies/baselines/exhaustive.py"),),
    "sparse": (str(ROOT / "studies/baselines/sparse.py"),),
    "armax": (str(ROOT / "studies/baselines/armax.py"),),
    "neural": (str(ROOT / "studies/baselines/neural.py"),),
}


@dataclass(frozen=True)
class CaseRun:
    """How a case went: exit status (None: stopped at the time limit), seconds, and the last lines it said."""

    status: int | None
    seconds: float
    said: str


def cases_of(folder: Path) -> list[str]:
    """Names of a draw's cases."""
    names = json.loads((folder / "cases.json").read_text())["cases"]
    return [str(name) for name in names]


def run(
    folder: Path,
    method: str,
    limit: float,
    jobs: int,
    report: Callable[[str, CaseRun], None] = lambda name, ran: None,
) -> None:
    """Run `method` on each case that it has not finished; results stand in DIR/CASE/METHOD.

    Args:
        folder: of the draw. The seal in it stays shut.
        method: one of METHODS.
        limit: seconds that a case may take.
        jobs: cases at a time; if there are several, each has one thread.
        report: is told of every case that ends.
    """
    left = [name for name in cases_of(folder) if not finished(folder / name / method)]
    limits = Limits(threads=1 if jobs > 1 else os.cpu_count() or 1, time_limit=math.inf, deadline=limit)
    with ThreadPoolExecutor(jobs) as pool:
        work = partial(_one, folder, method, limits)
        for name, ran in pool.map(work, left):
            report(name, ran)


def finished(place: Path) -> bool:
    """It came to an end of its own, or its time was up; a case that someone else stopped is run again."""
    left = place / "run.json"
    if not left.exists():
        return False
    status = json.loads(left.read_text())["status"]
    return status is None or status >= 0


def _one(folder: Path, method: str, limits: Limits, name: str) -> tuple[str, CaseRun]:
    case, out = folder / name, folder / name / method
    recordings = [str(case / f"{r}.csv") for r in TRAIN]
    call = [
        sys.executable,
        *METHODS[method],
        str(case / "rig.toml"),
        *recordings,
        "--holdout",
        str(case / f"{HELD_OUT}.csv"),
        "--out",
        str(out),
    ]
    ended = supervise(call, limits, ROOT)
    stopped = ended.outcome in (Outcome.TIMED_OUT, Outcome.OUT_OF_MEMORY)
    ran = CaseRun(None if stopped else ended.status, ended.seconds, ended.said[-2000:])
    out.mkdir(exist_ok=True)
    record = {"status": ran.status, "seconds": round(ran.seconds, 1), "said": ran.said}
    (out / "run.json").write_text(json.dumps(record, indent=1) + "\n")
    return name, ran
