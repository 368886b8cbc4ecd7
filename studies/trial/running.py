"""Running a method on every case of a draw: a process each, with a time limit, on all cores, resuming."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from queue import Queue

from studies.trial.record import HELD_OUT, TRAIN

ROOT = Path(__file__).parents[2]
METHODS = {
    "diagnose": ("-m", "optid.cli", "diagnose"),
    "exhaustive": (str(ROOT / "studies/baselines/exhaustive.py"),),
    "sparse": (str(ROOT / "studies/baselines/sparse.py"),),
    "armax": (str(ROOT / "studies/baselines/armax.py"),),
    "neural": (str(ROOT / "studies/baselines/neural.py"),),
}
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


@dataclass(frozen=True)
class Ran:
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
    report: Callable[[str, Ran], None] = lambda name, ran: None,
) -> None:
    """Run `method` on each case that it has not finished; results stand in DIR/CASE/METHOD.

    Args:
        folder: of the draw. The seal in it stays shut.
        method: one of METHODS.
        limit: seconds that a case may take.
        jobs: cases at a time; if there are several, each has a core and a thread of its own.
        report: is told of every case that ends.
    """
    left = [name for name in cases_of(folder) if not finished(folder / name / method)]
    environment = dict(os.environ)
    if jobs > 1:
        environment |= dict.fromkeys(THREADS, "1")
    cores: Queue[set[int]] = Queue()
    every = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
    for job in range(jobs):
        cores.put({every[job % len(every)]} if jobs > 1 and every else set(every))
    with ThreadPoolExecutor(jobs) as pool:
        work = partial(_one, folder, method, limit, environment, cores)
        for name, ran in pool.map(work, left):
            report(name, ran)


def finished(place: Path) -> bool:
    """It came to an end of its own, or its time was up; a case that someone else stopped is run again."""
    left = place / "run.json"
    if not left.exists():
        return False
    status = json.loads(left.read_text())["status"]
    return status is None or status >= 0


def _one(
    folder: Path, method: str, limit: float, environment: dict[str, str], cores: Queue[set[int]], name: str
) -> tuple[str, Ran]:
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
    mine = cores.get()
    try:
        ran = timed(call, limit, environment, mine)
    finally:
        cores.put(mine)
    out.mkdir(exist_ok=True)
    record = {"status": ran.status, "seconds": round(ran.seconds, 1), "said": ran.said}
    (out / "run.json").write_text(json.dumps(record, indent=1) + "\n")
    return name, ran


def timed(call: Sequence[str], limit: float, environment: dict[str, str], cores: Collection[int] = ()) -> Ran:
    """Run a program, on these cores if any are named, and end it with all it started when its time is up."""
    began = time.monotonic()
    process = subprocess.Popen(
        call,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=environment,
        start_new_session=True,
    )
    if cores and hasattr(os, "sched_setaffinity"):
        with suppress(ProcessLookupError):  # it may have ended already
            os.sched_setaffinity(process.pid, cores)
    try:
        said, _ = process.communicate(timeout=limit)
        status: int | None = process.returncode
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)  # the group that it leads: itself and what it started
        said, _ = process.communicate()
        status = None
    return Ran(status, time.monotonic() - began, said[-2000:])
