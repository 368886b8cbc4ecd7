"""What a fleet costs: rows by hand and through it, many small jobs, and a million recordings on paper."""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import sys
import time
from concurrent.futures import wait
from pathlib import Path
from typing import Any

import pandas as pd
import psutil

from optid.fleet.cluster import connected
from studies.plant.cluster import Cluster

ROOT = Path(__file__).parents[2]
BENCH = ROOT / "data" / "bench.toml"
SHORT = 1000  # rows of data/bench.csv that a small job reads
MILLION = 1_000_000  # recordings a day
DAY = 86_400.0  # s
EMPTY = 2000  # tasks that do nothing, by which the scheduler's limit is measured


def check_rows(folder: Path, count: int, rows: int = SHORT) -> Path:
    """A fleet file of so many checks of a short recording.

    Args:
        folder: for it.
        count: of rows.
        rows: of the recording.
    """
    folder.mkdir(parents=True, exist_ok=True)
    pd.read_csv(ROOT / "data" / "bench.csv", comment="#").head(rows).to_csv(folder / "short.csv", index=False)
    shutil.copy(BENCH, folder / "bench.toml")
    lines = ["[defaults]", 'job = "check"', "retries = 0"]
    for number in range(count):
        lines += [
            "[[rows]]",
            f'name = "row-{number:04}"',
            'rig = "bench.toml"',
            'train = ["short.csv"]',
            f'tags = {{ number = "{number}" }}',
        ]
    file = folder / "fleet.toml"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file


def throughput(folder: Path, rows: int, workers: list[int]) -> dict[str, Any]:
    """Seconds of a core of a row by hand and through the fleet, and wall time on some numbers of workers.

    Args:
        folder: for the fleets.
        rows: of each.
        workers: how many at a time.
    """
    file = check_rows(folder, rows, 8000)
    own = _own_seconds(
        [
            [
                *("-m", "optid.cli", "check", str(folder / "bench.toml"), str(folder / "short.csv")),
                *("--threads", "1", "--progress", "none", "--out", str(folder / f"hand-{number}")),
            ]
            for number in range(rows)
        ]
    )
    found: dict[str, Any] = {"rows": rows, "by_hand": own}
    for count in workers:
        out = folder / f"out-{count}"
        shutil.rmtree(out, ignore_errors=True)
        call = ["-m", "optid.cli", "fleet", str(file), "--out", str(out), "--threads", str(count)]
        ran = _own_seconds([call])
        jobs = [json.loads(one.read_text(encoding="utf-8")) for one in out.glob("*/run.json")]
        busy = sum(job["seconds"] for job in jobs)
        found[f"{count} workers"] = {
            **ran,
            "overhead_a_row": (ran["cpu_seconds"] - own["cpu_seconds"]) / rows,
            "busy": busy / (count * ran["seconds"]),
        }
    first, *others = (found[f"{count} workers"]["seconds"] for count in workers)
    found["efficiency"] = {
        str(count): first * workers[0] / (count * one) for count, one in zip(workers[1:], others, strict=True)
    }
    return found


def small(folder: Path, rows: int) -> dict[str, Any]:
    """Many small jobs: the most memory that the client had, over the run.

    Args:
        folder: for the fleet; one that was begun is gone on with.
        rows: of it.
    """
    file, out = check_rows(folder, rows, 300), folder / "out"
    call = [sys.executable, "-m", "optid.cli", "fleet", str(file), "--out", str(out), "--progress", "none"]
    began, process = time.monotonic(), subprocess.Popen(call, stdout=subprocess.DEVNULL)
    held: list[tuple[float, float]] = []
    client = psutil.Process(process.pid)
    while process.poll() is None:
        try:
            held.append((time.monotonic() - began, client.memory_info().rss / 1e6))
        except psutil.Error:
            break
        time.sleep(0.5)
    answered = len(list(out.glob("*/run.json")))
    memory = [one for _, one in held]
    tenths = [max(memory[k * len(memory) // 10 : (k + 1) * len(memory) // 10 or None]) for k in range(10)]
    return {
        "rows": rows,
        "answered": answered,
        "status": process.wait(),
        "seconds": round(time.monotonic() - began, 1),
        "client_memory_MB": round(max(memory), 1),
        "by_tenth_of_the_run_MB": [round(one, 1) for one in tenths],
    }


def paper(folder: Path) -> dict[str, Any]:
    """What a million recordings a day take, from what was measured in a folder.

    Args:
        folder: where `score` and `throughput` left their figures.
    """
    score = json.loads((folder / "score.json").read_text(encoding="utf-8"))
    load = json.loads((folder / "throughput.json").read_text(encoding="utf-8"))
    rows = load["rows"]
    start = load["by_hand"]["cpu_seconds"] / rows + load["1 workers"]["overhead_a_row"]
    run = next(iter((folder / "out-1").glob("*/run.json")))
    kept = sum(file.stat().st_size for file in run.parent.iterdir())
    test, limit = score["seconds_a_test"], _scheduled(folder)
    return {
        "tasks_a_second_of_one_scheduler": limit,
        "cores_a_process_each": MILLION * (start + test) / DAY,
        "cores_if_a_process_did_many": MILLION * test / DAY,
        "rows_a_second": MILLION / DAY,
        "scheduler_share": MILLION / DAY / limit,
        "folder_bytes_a_row": kept,
        "storage_GB_a_day": MILLION * kept / 1e9,
    }


def _scheduled(folder: Path) -> float:
    """Tasks a second that a scheduler gives to two workers here when they do nothing."""
    with Cluster(folder) as cluster, connected(cluster.address) as executor:
        wait([executor.submit(abs, number) for number in range(20)])
        began = time.monotonic()
        wait([executor.submit(abs, -number) for number in range(EMPTY)])
        return EMPTY / (time.monotonic() - began)


def _own_seconds(calls: list[list[str]]) -> dict[str, float]:
    """Wall and core seconds of some programs, one after the other."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    for call in calls:
        subprocess.run([sys.executable, *call], stdout=subprocess.DEVNULL, check=False, env=dict(os.environ))
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"seconds": time.monotonic() - began, "cpu_seconds": spent}
