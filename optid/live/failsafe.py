"""The safe command, tried until it is put: with back-off, and through a fresh connection where the old one fails."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass

from optid.live.driver import Driver

FIRST, LONGEST = 0.01, 0.5  # s between tries, doubled each time
SAME = 2  # tries on a connection before it is given up for a fresh one
LEAST = 3  # tries, however short the time is


@dataclass(frozen=True)
class WriteOutcome:
    """What came of it.

    Attributes:
        driver: that took the command, or the last one; ``None`` where none could be opened.
        seconds: until it was put; ``None`` where it was not.
        error: of the last try that failed, "" without any.
    """

    driver: Driver | None
    seconds: float | None
    error: str


@dataclass(frozen=True)
class Failsafe:
    """How long, and through what.

    Attributes:
        seconds: for which it is tried.
        reopen: makes a fresh connection; ``None`` where there can be none.
        announce: called once when the first try has failed.
    """

    seconds: float = 0.0
    reopen: Callable[[], Driver] | None = None
    announce: Callable[[], None] = lambda: None

    def put(self, driver: Driver | None, write: Callable[[Driver], object]) -> WriteOutcome:
        """Write until that succeeds or the time is over.

        Args:
            driver: open already; ``None`` opens one.
            write: puts the safe command through a driver.
        """
        begun, wait, failed, error = time.monotonic(), FIRST, 0, ""
        while True:
            try:
                driver = driver or self._fresh()
                write(driver)
                return WriteOutcome(driver, time.monotonic() - begun, error)
            except (Exception, SystemExit) as problem:  # whatever a driver raises
                error = f"{type(problem).__name__}: {problem}".rstrip(": ")
            failed += 1
            if failed == 1:
                self.announce()
            if failed >= SAME and self.reopen is not None and driver is not None:
                with contextlib.suppress(Exception):
                    driver.close()  # first: many a rig serves one connection only
                driver = None
            left = begun + self.seconds - time.monotonic()
            if left <= 0.0 and failed >= LEAST:
                return WriteOutcome(driver, None, error)
            time.sleep(min(wait, max(left, FIRST)))
            wait = min(2 * wait, LONGEST)

    def _fresh(self) -> Driver:
        if self.reopen is None:
            raise ConnectionError("there is no connection to the rig")
        return self.reopen()
