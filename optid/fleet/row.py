"""The folder of a row: who works in it, and `run.json`, written last, which says that it is answered and how."""

from __future__ import annotations

import contextlib
import json
import os
import shlex
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from optid.core.document import optional_document
from optid.core.resultset import MANIFEST, manifest
from optid.core.version import version
from optid.fleet.job import Job, inputs_of, key_of
from optid.fleet.process import Outcome, ProcessResult, bounded, end_left_over, supervise

RUN = "run.json"
SCHEMA = "optid.run/1"
CLAIM, PROCESS = ".claim", ".process"
WAIT = 0.2  # s between looks whether another worker has let go of a row


def answer(document: dict[str, Any], out: str) -> dict[str, Any]:
    """Do a job, unless its row is answered already; may run anywhere that sees the same files.

    Parameters
    ----------
    document : dict[str, Any]
        of the job, as `Job.document` gives it.
    out : str
        folder of the fleet, in which each row has one.

    Returns
    -------
    dict[str, Any]
        Name, outcome, whether it was `fresh`, and seconds.
    """
    job = Job.of(document)
    place = Path(out) / job.name
    place.mkdir(parents=True, exist_ok=True)
    with _claimed(place):
        inputs = inputs_of(job)
        key = key_of(job, inputs, version())
        done = read_run(place)
        fresh = done is None or done["key"] != key
        if done is None or fresh:
            done = _work(job, place, key, inputs)
    told = {name: done[name] for name in ("outcome", "seconds", "cpu_seconds", "said")}
    return {"name": job.name, "fresh": fresh, **told}


def read_run(place: Path) -> dict[str, Any] | None:
    """The content of a row's `run.json`; ``None`` where the row is not answered."""
    content = optional_document(place / RUN)
    known = content is not None and content.get("schema") == SCHEMA and "key" in content
    return content if known else None


def is_running(place: Path) -> bool:
    """Somebody works in this row's folder at present, here or on a machine that shares its locks."""
    try:
        descriptor = os.open(place / CLAIM, os.O_RDWR)
    except OSError:
        return False
    try:
        return not _lock(descriptor)
    finally:
        os.close(descriptor)


def _work(job: Job, place: Path, key: str, inputs: dict[str, str | None]) -> dict[str, Any]:
    (place / RUN).unlink(missing_ok=True)
    end_left_over(place / PROCESS)
    began, before = datetime.now(UTC), _written(place)
    attempts, ended = 0, None
    while ended is None or (ended.outcome is Outcome.CRASHED and attempts <= job.limits.retries):
        call = bounded(job.arguments(place.resolve()), job.limits)
        ended = supervise(call, job.limits, place, place / PROCESS)
        attempts += 1
    (place / PROCESS).unlink(missing_ok=True)
    fresh = ended.outcome in (Outcome.DONE, Outcome.FAILED) and _written(place) != before
    content = _document(job, key, inputs, ended, manifest(place) if fresh else None)
    content |= {
        "command": shlex.join(["optid", *job.arguments(place.resolve())]),
        "began": began.isoformat(timespec="seconds"),
        "attempts": attempts,
        "host": socket.gethostname(),
    }
    _write(place / RUN, content)
    return content


def _written(place: Path) -> int:
    """When the results in a folder were committed, ns; 0 where there are none."""
    try:
        return (place / MANIFEST).stat().st_mtime_ns
    except OSError:
        return 0


def _document(
    job: Job, key: str, inputs: dict[str, str | None], ended: ProcessResult, told: dict[str, Any] | None
) -> dict[str, Any]:
    """What `run.json` holds; `told` is the manifest of what the command committed while it ran."""
    return {
        "schema": SCHEMA,
        "version": version(),
        "key": key,
        "job": job.document(),
        "inputs": inputs,
        "outcome": ended.outcome.value,
        "status": ended.status,
        "seconds": round(ended.seconds, 3),
        "cpu_seconds": round(ended.cpu_seconds, 3),
        "memory": ended.memory,
        "said": ended.said,
        "files": told["files"] if told is not None else {},
    }


def _write(path: Path, content: dict[str, Any]) -> None:
    """The file appears whole, once the disk holds it."""
    fresh = path.with_name(f".{path.name}.new")
    with fresh.open("w", encoding="utf-8") as file:
        json.dump(content, file, indent=1, ensure_ascii=False)
        file.write("\n")
        file.flush()
        os.fsync(file.fileno())
    fresh.replace(path)


@contextmanager
def _claimed(place: Path) -> Iterator[None]:
    """Work alone in a folder: whoever comes second waits, and then finds the row answered."""
    descriptor = os.open(place / CLAIM, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        while not _lock(descriptor):
            time.sleep(WAIT)
        yield
    finally:
        os.close(descriptor)


def _lock(descriptor: int) -> bool:
    """The lock that ends with the process that has it; true as well where the file system knows none."""
    with contextlib.suppress(ImportError):
        import fcntl

        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:
            return True
    return True
