"""Do sessions of `optid live` start and end well on a machine that is busy?

    python studies/live_starts.py [--sessions 20] [--load 12] [--nice 0] [--seconds 2] [--out DIR]

Processes that only count are started until so many want the processors together with whatever else runs; then sessions
of data/bench.toml with the simulated driver run one after the other, by the clock at 1 kHz. A session counts as
started if it ends with "the time is over" and the safe command. Rows are kept in DIR/live_starts.json, and a run that
was cut goes on from there. Needs Linux's /proc.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
COUNTING = "while True: pass"


def running() -> int:
    """Processes that want a processor now, this one not counted."""
    return int(Path("/proc/loadavg").read_text(encoding="utf-8").split()[3].split("/")[0]) - 1


@contextlib.contextmanager
def busy(load: int, nice: int) -> Iterator[int]:
    """A machine on which so many processes want a processor; how many of them are ours."""
    seen = []
    for _ in range(25):
        time.sleep(0.2)
        seen.append(running())
    command = ["nice", "-n", str(nice), sys.executable, "-c", COUNTING]
    others = sorted(seen)[len(seen) // 2]
    ours = [subprocess.Popen(command) for _ in range(max(load - others, 0))]
    try:
        yield len(ours)
    finally:
        for one in ours:
            one.kill()
            one.wait()


def session(seconds: float) -> dict[str, Any]:
    """One session: how it ended, and how long it took to begin."""
    with tempfile.TemporaryDirectory() as folder:
        shutil.copy(ROOT / "data" / "bench.toml", folder)
        call = [sys.executable, "-m", "optid.cli", "live", "bench.toml", "--seconds", f"{seconds:g}"]
        begun = time.monotonic()
        done = subprocess.run(
            [*call, "--rate", "1000", "--out", "out"],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
        )
        took = time.monotonic() - begun
        path = Path(folder) / "out" / "live.json"
        end = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    return {
        "started": done.returncode == 0 and end.get("outcome") == "done" and end.get("safe") is True,
        "seconds": round(took, 1),
        "samples": end.get("samples", 0),
        "missed": end.get("missed", 0),
        "why": end.get("why") or done.stderr[-300:],
    }


def main() -> None:
    """All sessions."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sessions", type=int, default=20)
    parser.add_argument("--load", type=int, default=12)
    parser.add_argument("--nice", type=int, default=0, help="of the processes that only count")
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "live_starts")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    path = arguments.out / "live_starts.json"
    rows: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else []
    with busy(arguments.load, arguments.nice) as ours:
        print(f"{ours} processes that only count beside what else runs, {os.cpu_count()} processors")
        while len(rows) < arguments.sessions:
            one = session(arguments.seconds)
            rows.append({**one, "load": round(os.getloadavg()[0], 1), "running": running()})
            path.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
            print(f"{len(rows):3d} {rows[-1]}", flush=True)
    started = sum(one["started"] for one in rows)
    loads = sorted(one["running"] for one in rows)
    print(
        f"{started} of {len(rows)} sessions; {loads[0]} to {loads[-1]} processes wanted a processor, "
        f"median {loads[len(loads) // 2]}"
    )


if __name__ == "__main__":
    main()
