"""Bounds that the process of a job lays on itself: the kernel keeps them, whatever its own code does."""

from __future__ import annotations

import os
import signal
import sys

# Times the resident memory that may be mapped: compilers and thread stacks reserve what they never use.
ROOM = 4
_DEATH_SIGNAL = 1  # PR_SET_PDEATHSIG of prctl(2)


def bound(memory: int, seconds: float) -> None:
    """Have the kernel refuse more memory and end a process that computes longer; not where it cannot."""
    try:
        import resource
    except ImportError:  # Windows
        return
    _, hard = resource.getrlimit(resource.RLIMIT_CPU)
    most = int(seconds) + 1
    if hard == resource.RLIM_INFINITY or most < hard:
        resource.setrlimit(resource.RLIMIT_CPU, (most, most + 5))
    resource.setrlimit(resource.RLIMIT_DATA, (ROOM * memory, ROOM * memory))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def die_with(parent: int) -> None:
    """End when the process that waits for this one ends, however it does; on Linux."""
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(_DEATH_SIGNAL, signal.SIGKILL, 0, 0, 0)
        if os.getppid() != parent:  # it had ended before
            os._exit(1)
