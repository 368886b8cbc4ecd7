"""One program in a process of its own, bounded in memory and time, and killed with all it started when it is over."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import IO

from optid.errors import InputError
from optid.fleet.job import Limits

try:
    import psutil
except ImportError:
    raise InputError("needs the package psutil", where="fleet", hint='pip install "optid[fleet]"') from None

if hasattr(os, "killpg"):
    KILL, _end_group, _ended = signal.SIGKILL, os.killpg, os.wait4

PROGRAM = (
    sys.executable,
    "-m",
    "optid.cli.bounded",
)  # is told memory, seconds, whose child it is, and the arguments
LAST = 4000  # characters that are kept of what a program says
LOOK = 0.25  # s between looks at a process's memory; it is noticed sooner that it ended
GRACE = 1.0  # s that a process of a worker that was killed may still take to end


class Outcome(Enum):
    """How a row ended."""

    DONE = "done"
    FAILED = "failed"
    BAD_INPUT = "bad-input"
    TIMED_OUT = "timed-out"
    OUT_OF_MEMORY = "out-of-memory"
    CRASHED = "crashed"


@dataclass(frozen=True)
class ProcessResult:
    """How a process ended.

    Attributes
    ----------
    outcome : Outcome
        what became of it.
    status : int
        exit status; minus the signal that ended it.
    seconds : float
        by the clock.
    cpu_seconds : float
        of the process's own time.
    memory : int
        most that was resident, bytes.
    said : str
        the last that it wrote to either stream.
    """

    outcome: Outcome
    status: int
    seconds: float
    cpu_seconds: float
    memory: int
    said: str


class Stopped(Exception):
    """The fleet is being ended: nothing may be said of this job."""


_LOCK = threading.Lock()
_RUNNING: set[int] = set()
_STOPPING = threading.Event()


def stop_all() -> None:
    """Kill every job that this process runs, and start no other until `start_again`."""
    with _LOCK:
        _STOPPING.set()
        for group in _RUNNING:
            kill_group(group)


def start_again() -> None:
    """Jobs may be begun."""
    _STOPPING.clear()


def bounded(arguments: Sequence[str], limits: Limits) -> list[str]:
    """The program that runs the command line of optid within limits that the kernel keeps.

    Parameters
    ----------
    arguments : Sequence[str]
        what stands behind `optid`.
    limits : Limits
        of the process.
    """
    return [*PROGRAM, str(limits.memory), str(limits.time_limit), str(os.getpid()), *arguments]


def supervise(call: Sequence[str], limits: Limits, folder: Path, begun: Path | None = None) -> ProcessResult:
    """Run a program, and wait for it; what exceeds the limits is killed with all it started.

    Parameters
    ----------
    call : Sequence[str]
        the program and its arguments.
    limits : Limits
        of the process.
    folder : Path
        working folder.
    begun : Path | None
        file to be told which process it is, so that another can end it.

    Raises
    ------
    Stopped
        `stop_all` was called.
    """
    if not hasattr(os, "killpg"):
        raise InputError(
            "needs a POSIX system, where a job can be ended together with all processes it started",
            where="fleet",
            hint="on Windows use WSL",
        )
    began = time.monotonic()
    with tempfile.TemporaryFile() as said:
        with _LOCK:
            if _STOPPING.is_set():
                raise Stopped
            process = subprocess.Popen(
                call,
                stdin=subprocess.DEVNULL,
                stdout=said,
                stderr=subprocess.STDOUT,
                cwd=folder,
                env=_environment(limits),
                start_new_session=True,
            )
            _RUNNING.add(process.pid)
        try:
            if begun is not None:
                begun.write_text(
                    f"{process.pid} {psutil.Process(process.pid).create_time()}", encoding="utf-8"
                )
            status, usage, over, seen = _watched(process, limits, began)
        finally:
            kill_group(process.pid)  # what it started and left behind
            with _LOCK:
                _RUNNING.discard(process.pid)
        if _STOPPING.is_set():
            raise Stopped
        words = _tail(said)
    outcome = over or _outcome(status, words)
    return ProcessResult(outcome, status, time.monotonic() - began, usage[0], max(usage[1], seen), words)


def kill_group(group: int) -> None:
    """End a process group for good; nothing where it has ended."""
    with suppress(ProcessLookupError, PermissionError):
        _end_group(group, KILL)


def end_left_over(begun: Path) -> None:
    """End the process that `supervise` told of, should it have outlived whoever waited for it."""
    try:
        number, created = begun.read_text(encoding="utf-8").split()
        left = psutil.Process(int(number))
        if abs(left.create_time() - float(created)) < GRACE:
            kill_group(left.pid)
            left.wait(10.0)
    except (OSError, ValueError, psutil.Error):
        return


def _environment(limits: Limits) -> Mapping[str, str]:
    names = ("OPTID", "OMP", "OPENBLAS", "MKL", "NUMBA", "BLIS")
    threads = {
        f"{name}_{'THREADS' if name == 'OPTID' else 'NUM_THREADS'}": str(limits.threads) for name in names
    }
    kept = {name: value for name, value in os.environ.items() if name != "OPTID_TRACEBACK"}
    return {**kept, **threads, "OPTID_PLOTLY": "../plotly-basic.min.js", "PYTHONUNBUFFERED": "1"}


def _watched(
    process: subprocess.Popen[bytes], limits: Limits, began: float
) -> tuple[int, tuple[float, int], Outcome | None, int]:
    """Exit status, (own seconds, most bytes), what it exceeded if anything, and the most bytes seen of its group."""
    seen, over, look, nap = 0, None, time.monotonic(), 0.01
    while True:
        number, status, usage = _ended(process.pid, os.WNOHANG)
        if number:
            process.returncode = os.waitstatus_to_exitcode(status)
            spent = usage.ru_utime + usage.ru_stime
            if over is None and process.returncode == -KILL and spent >= limits.time_limit:
                over = Outcome.TIMED_OUT
            return process.returncode, (spent, usage.ru_maxrss * _UNIT), over, seen
        now = time.monotonic()
        if over is None and now >= look:
            look = now + LOOK
            seen = max(seen, _resident(process.pid))
            if now - began > limits.deadline:
                over = Outcome.TIMED_OUT
            elif seen > limits.memory:
                over = Outcome.OUT_OF_MEMORY
            if over is not None:
                kill_group(process.pid)
        time.sleep(nap)
        nap = min(1.5 * nap, 0.1)


_UNIT = 1 if sys.platform == "darwin" else 1024  # bytes of ru_maxrss


def _resident(number: int) -> int:
    """Bytes that a process and all below it hold."""
    try:
        top = psutil.Process(number)
        return sum(_held(one) for one in (top, *top.children(recursive=True)))
    except psutil.Error:
        return 0


def _held(process: psutil.Process) -> int:
    try:
        return int(process.memory_info().rss)
    except psutil.Error:
        return 0


def _outcome(status: int, said: str) -> Outcome:
    if status == 0:
        return Outcome.DONE
    if status == -getattr(signal, "SIGXCPU", 24):
        return Outcome.TIMED_OUT
    if status < 0:
        return Outcome.CRASHED
    if "MemoryError" in said or "std::bad_alloc" in said:
        return Outcome.OUT_OF_MEMORY
    return {1: Outcome.FAILED, 2: Outcome.BAD_INPUT}.get(status, Outcome.CRASHED)


def _tail(said: IO[bytes]) -> str:
    size = said.seek(0, os.SEEK_END)
    said.seek(max(0, size - LAST))
    return said.read().decode("utf-8", "replace").strip()
