"""Work on all cores: kernels hold no lock, so threads are enough. Symbolic work is for one thread at a time."""

from __future__ import annotations

import gc
import itertools
import os
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache, wraps
from typing import ParamSpec, TypeVar

VARIABLE = "OPTID_THREADS"


def _allowed() -> int:
    """The cores that this process may use, or fewer if the environment limits them."""
    here = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    granted = os.environ.get(VARIABLE, "")
    return max(1, min(here, int(granted)) if granted.isdecimal() and int(granted) > 0 else here)


WORKERS = _allowed()

Item = TypeVar("Item")
Result = TypeVar("Result")
Given = ParamSpec("Given")

_here = threading.local()
_symbolic = threading.RLock()


def limit(cores: int | None) -> None:
    """Limit the number of cores from now on; ``None`` restores the initial number."""
    global WORKERS
    allowed = _allowed()
    WORKERS = allowed if cores is None else max(1, min(cores, allowed))
    _kernels.cache_clear()
    _searches.cache_clear()


def parallel_for(count: int, work: Callable[[int, int], None], grain: int = 1) -> None:
    """Run ``work(first, last)``, which calls a kernel, over 0..count in as many threads as there are cores.

    `first` is a multiple of `grain`.
    """
    chunks = min(2 * WORKERS, -(-count // grain))  # two per core, because windows differ in effort
    if chunks <= 1 or WORKERS == 1:
        work(0, count)
        return
    edges = [*(round(i * count / chunks / grain) * grain for i in range(chunks)), count]
    for future in [_kernels().submit(work, a, b) for a, b in itertools.pairwise(edges)]:
        future.result()


def parallel_map(work: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """``work(item)`` of each, in their order, as many at a time as there are cores.

    A search runs few simulations at once, and uses one core between them: two searches side by side leave no core idle.
    Items must be independent. A call inside of `work` runs them one after the other, so that threads do not wait for
    each other.

    Raises:
        Whatever `work` raises, of the first item that it does so for.
    """
    if WORKERS == 1 or getattr(_here, "searching", False):
        return [work(item) for item in items]

    return list(_searches().map(work, items))


def one_at_a_time(work: Callable[Given, Result]) -> Callable[Given, Result]:
    """Run a function that builds expressions in one thread at a time, and not during garbage collection.

    CasADi gives up Python's lock while it builds. Expressions of different models share their constants, and a thread
    that releases one while another acquires it has crashed the process.
    """

    @wraps(work)
    def alone(*args: Given.args, **kwargs: Given.kwargs) -> Result:
        with _symbolic:
            collects = gc.isenabled()
            gc.disable()
            try:
                return work(*args, **kwargs)
            finally:
                if collects:
                    gc.enable()

    return alone


# Apart, as a search waits for the kernels that it calls.
@lru_cache(maxsize=1)
def _kernels() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(WORKERS, "optid-kernel")


@lru_cache(maxsize=1)
def _searches() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(WORKERS, "optid-search", initializer=lambda: setattr(_here, "searching", True))
