"""Running jobs on an executor: a few ahead at a time, so that the client stays small however many there are."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ThreadPoolExecutor,
    wait,
)
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from optid.core import threads
from optid.errors import InputError, JobError
from optid.fleet.job import Job
from optid.fleet.process import Stopped, start_again, stop_all
from optid.fleet.row import answer

AHEAD = 256  # jobs that an executor of the caller's is given before the first is done
LOOK = 2.0  # s between looks whether an executor is still there
GLANCE = 0.1  # s between looks at jobs that cannot be waited for
LOST = 3  # times that a job may be lost with a worker before the row is given up

Report = Callable[[float, str], None]


@dataclass(frozen=True)
class RowResult:
    """The outcome of one row.

    Attributes
    ----------
    name : str
        of the row.
    outcome : str
        of `optid.fleet.process.Outcome`, or "lost" where its workers ended before it did.
    fresh : bool
        it was worked on now, not answered before.
    seconds : float
        by the clock, of its process.
    cpu_seconds : float
        of the process's own time.
    said : str
        the last that it said.
    """

    name: str
    outcome: str
    fresh: bool
    seconds: float
    cpu_seconds: float
    said: str


def run_jobs(
    jobs: Iterable[Job],
    out: Path,
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    report: Callable[[RowResult], None] = lambda ran: None,
) -> dict[str, int]:
    """Answer every job that is not answered yet.

    Parameters
    ----------
    jobs : Iterable[Job]
        names unique.
    out : Path
        folder of the fleet, which the executor's workers see under the same path.
    executor : Executor | None
        what runs them; when absent, `workers` threads here that wait for a process each.
    workers : int | None
        jobs at a time without an executor; as many as cores when absent.
    report : Callable[[RowResult], None]
        told of each that ends.

    Returns
    -------
    dict[str, int]
        Number of rows by outcome.

    Raises
    ------
    InputError
        two jobs have the same name.
    JobError
        the executor is lost; what is answered is kept.
    """
    if executor is not None:
        return _through(executor, jobs, out, AHEAD, report)
    count = workers or threads.WORKERS
    with ThreadPoolExecutor(count, "optid-fleet") as pool:
        try:
            return _through(pool, jobs, out, 2 * count, report)
        except BaseException:
            stop_all()
            pool.shutdown(cancel_futures=True)
            start_again()
            raise


def _through(
    executor: Executor, jobs: Iterable[Job], out: Path, ahead: int, report: Callable[[RowResult], None]
) -> dict[str, int]:
    left, seen = iter(jobs), set[str]()
    pending: dict[Future[dict[str, Any]], tuple[Job, int]] = {}
    counts: dict[str, int] = {}
    more = True
    while more or pending:
        while more and len(pending) < ahead:
            job = next(left, None)
            more = job is not None
            if job is not None:
                if job.name in seen:
                    raise InputError(
                        "two jobs have this name", where=job.name, expected="names that are unique"
                    )
                seen.add(job.name)
                pending[_submit(executor, job, out)] = (job, 1)
        done = _first(pending)
        if not done and getattr(executor, "is_lost", False):
            raise JobError(
                f"the connection to the scheduler is lost; the rows finished so far are in {out}: run the command "
                "again to continue"
            )
        for future in done:
            job, attempt = pending.pop(future)
            ran = _ended(future, job)
            if ran.outcome == "lost" and attempt < LOST:
                pending[_submit(executor, job, out)] = (job, attempt + 1)
                continue
            counts[ran.outcome] = counts.get(ran.outcome, 0) + 1
            report(ran)
    return counts


def _first(pending: Iterable[Future[dict[str, Any]]]) -> set[Future[dict[str, Any]]]:
    """The finished jobs, as soon as there is one, or none after a while."""
    some = set(pending)
    if all(isinstance(one, Future) for one in some):
        return wait(some, timeout=LOOK, return_when=FIRST_COMPLETED).done
    # Jobs of submitit are not futures: they only have `done` and `result`.
    until = time.monotonic() + LOOK
    while not (done := {one for one in some if one.done()}) and time.monotonic() < until:
        time.sleep(GLANCE)
    return done


def _submit(executor: Executor, job: Job, out: Path) -> Future[dict[str, Any]]:
    try:
        return executor.submit(answer, job.document(), str(out))
    except (RuntimeError, OSError) as error:
        raise JobError(
            f"the executor accepts no more jobs ({error}); run the command again to continue"
        ) from None


def _ended(future: Future[dict[str, Any]], job: Job) -> RowResult:
    """The outcome of a row; failures of the job are in its answer, exceptions come from the executor."""
    try:
        return RowResult(**future.result())
    except BrokenExecutor as error:
        raise JobError(f"the executor is broken ({error}); run the command again to continue") from None
    except Stopped:
        raise
    except (Exception, CancelledError) as error:
        return RowResult(job.name, "lost", True, 0.0, 0.0, f"{type(error).__name__}: {error}")
