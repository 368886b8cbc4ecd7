"""A Dask cluster of real processes on this machine: a scheduler and workers, to be killed and started again."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

PATIENCE = 60.0  # s for anything to come up


class Cluster:
    """A scheduler and workers of one thread each; leaves no process behind.

    Args:
        folder: for their files.
        workers: how many.
        preload: a Python file that workers run first.
    """

    def __init__(self, folder: Path, workers: int = 2, preload: Path | None = None) -> None:
        self.folder, self.count, self.preload = folder, workers, preload
        self.scheduler: subprocess.Popen[bytes] | None = None
        self.workers: list[subprocess.Popen[bytes]] = []
        self.address = ""

    def __enter__(self) -> Self:
        """Start all."""
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Kill all."""
        self.stop()

    def start(self) -> None:
        """A new scheduler, and as many new workers."""
        self.stop()
        file = self.folder / "scheduler.json"
        file.unlink(missing_ok=True)
        self.scheduler = self._begun(
            "scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(file)
        )
        until = time.monotonic() + PATIENCE
        while not self.address_in(file):
            if time.monotonic() > until or self.scheduler.poll() is not None:
                raise RuntimeError("no scheduler came up")
            time.sleep(0.1)
        self.address = self.address_in(file)
        for _ in range(self.count):
            self.add_worker()

    def add_worker(self) -> None:
        """One more worker."""
        local = self.folder / "workers"
        options = ("--nthreads", "1", "--no-nanny", "--memory-limit", "0", "--local-directory", str(local))
        first = ("--preload", str(self.preload)) if self.preload is not None else ()
        self.workers.append(self._begun("worker", self.address, "--host", "127.0.0.1", *options, *first))

    def stop(self) -> None:
        """End all, for good."""
        for process in (*self.workers, *([self.scheduler] if self.scheduler else [])):
            kill(process)
        self.workers, self.scheduler = [], None

    @staticmethod
    def address_in(file: Path) -> str:
        """The address that a scheduler wrote into its file; empty as long as it has not."""
        try:
            return str(json.loads(file.read_text(encoding="utf-8"))["address"])
        except (OSError, ValueError, KeyError):
            return ""

    def _begun(self, what: str, *options: str) -> subprocess.Popen[bytes]:
        with (self.folder / f"{what}.log").open("ab") as log:
            return subprocess.Popen(
                [sys.executable, "-m", "distributed.cli.dask_" + what, *options, "--no-dashboard"],
                stdout=log,
                stderr=log,
                stdin=subprocess.DEVNULL,
                start_new_session=True,
                env=dict(os.environ),
            )


def kill(process: subprocess.Popen[bytes]) -> None:
    """SIGKILL, and wait."""
    with suppress(ProcessLookupError):
        process.send_signal(signal.SIGKILL)
    process.wait()
