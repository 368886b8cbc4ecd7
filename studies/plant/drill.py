"""The fault drill: kill -9 of a worker, of the scheduler and of the client, in turn, while rows run."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import psutil

from studies.plant.cluster import Cluster, kill
from studies.plant.load import check_rows

TARGETS = ("worker", "scheduler", "client")
PATIENCE = 120.0  # s in which a row must begin, or a client whose scheduler is lost end
SLOW = 60.0  # s that a row may take on a loaded machine


def drill(folder: Path, kills: int = 20, rows: int | None = None) -> dict[str, Any]:
    """Kill, go on, and count: rows answered, lost, and answered again although they were answered.

    Args:
        folder: for the fleet.
        kills: how many.
        rows: of the fleet; two a kill and some more if absent.
    """
    count = 2 * kills + 4 if rows is None else rows
    file, out = check_rows(folder, count), folder / "out"
    seen: dict[str, int] = {}
    again, orphans, done = [], 0, []
    with Cluster(folder) as cluster:
        client = _client(file, out, cluster.address)
        for number in range(kills):
            target = TARGETS[number % len(TARGETS)]
            if not _running(out, client):
                break  # all rows are answered
            if target == "worker":
                kill(cluster.workers.pop(0))
                orphans += _left_over(out, len(cluster.workers))
                cluster.add_worker()
            elif target == "scheduler":
                assert cluster.scheduler is not None
                kill(cluster.scheduler)
                client.wait(PATIENCE)
                cluster.start()
                client = _client(file, out, cluster.address)
            else:
                kill(client)
                client = _client(file, out, cluster.address)
            done.append(target)
            again += _noted(out, seen)
        client.wait(SLOW * count)
        again += _noted(out, seen)
        last = _client(file, out, cluster.address)
        status = last.wait(PATIENCE)
        again += _noted(out, seen)
    return {
        "kills": {target: done.count(target) for target in TARGETS},
        "rows": count,
        "answered": len(seen),
        "lost": count - len(seen),
        "answered_again": sorted(set(again)),
        "jobs_that_outlived_their_worker": orphans,
        "status_of_the_last_run": status,
        "processes_left": len(_processes(out)),
    }


def _client(file: Path, out: Path, address: str) -> subprocess.Popen[bytes]:
    call = [sys.executable, "-m", "optid.cli", "fleet", str(file), "--out", str(out), "--on", address]
    with (out.parent / "client.log").open("ab") as log:
        return subprocess.Popen(
            call, stdout=log, stderr=log, stdin=subprocess.DEVNULL, start_new_session=True
        )


def _running(out: Path, client: subprocess.Popen[bytes]) -> bool:
    """Wait until a job runs; false if the client ends before."""
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        if _processes(out):
            return True
        if client.poll() is not None:
            return False
        time.sleep(0.1)
    raise RuntimeError("no row began")


def _processes(out: Path) -> list[psutil.Process]:
    """The jobs' processes of this fleet that are alive."""
    found = []
    for one in psutil.process_iter(["cmdline", "status"]):
        words = one.info["cmdline"] or []
        ours = "optid.cli.bounded" in words and any(word.startswith(str(out)) for word in words)
        if ours and one.info["status"] != psutil.STATUS_ZOMBIE:
            found.append(one)
    return found


def _left_over(out: Path, workers: int) -> int:
    """Jobs beyond those that so many workers may run, a moment after one was killed."""
    time.sleep(0.5)
    return max(0, len(_processes(out)) - workers)


def _noted(out: Path, seen: dict[str, int]) -> list[str]:
    """Note which rows are answered; those that were, and have another answer now."""
    again = []
    for file in out.glob("*/run.json"):
        stamp = file.stat().st_mtime_ns
        if seen.setdefault(file.parent.name, stamp) != stamp:
            again.append(file.parent.name)
    return again
