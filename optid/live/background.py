"""One job at a time in a process of its own, at a lower priority than the loop's."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from typing import Any, Generic, TypeVar

NICENESS = 10  # a real-time loop has priority
Result = TypeVar("Result")


class Background(Generic[Result]):
    """A process that is started when it is first needed.

    Args:
        yields: it runs at the lowest priority.
    """

    def __init__(self, yields: bool) -> None:
        self._yields = yields
        self._pool: ProcessPoolExecutor | None = None
        self._future: Future[Result] | None = None

    @property
    def busy(self) -> bool:
        """Whether a job is running."""
        return self._future is not None

    def begin(self, job: Callable[..., Result], *arguments: Any) -> None:
        """Start a job; call `result` until `busy` is false."""
        if self._pool is None:
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(1, context, _step_back if self._yields else None)
        self._future = self._pool.submit(job, *arguments)

    def result(self) -> Result | None:
        """The job's result, once; ``None`` while there is none.

        Raises:
            Exception: whatever the job raised, or the death of its process.
        """
        if self._future is None or not self._future.done():
            return None
        future, self._future = self._future, None
        try:
            return future.result()
        except BaseException:
            if self._pool is not None:  # it may have died
                self._pool.shutdown(wait=False)
                self._pool = None
            raise

    def close(self) -> None:
        """Cancel the job."""
        if self._pool is not None:
            for process in multiprocessing.active_children():
                if process.pid in (self._pool._processes or {}):
                    process.terminate()
            self._pool.shutdown(wait=True, cancel_futures=True)


def _step_back() -> None:
    if hasattr(os, "nice"):
        os.nice(NICENESS)
