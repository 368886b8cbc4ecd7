"""The safe command, written with retries: with back-off, and through a new connection if the old one fails."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass

from optid.live.driver import Driver

FIRST, LONGEST = 0.01, 0.5  # s between tries, doubled each time
SAME = 2  # tries on a connection before a new one is opened
LEAST = 3  # smallest number of tries


@dataclass(frozen=True)
class WriteOutcome:
    """The outcome of writing the safe command.

    Attributes:
        driver: that accepted the command, or the last one tried; ``None`` if none could be opened.
        seconds: until it was written; ``None`` if it was not.
        error: of the last try that failed, "" without any.
    """

    driver: Driver | None
    seconds: float | None
    error: str


@dataclass(frozen=True)
class Failsafe:
    """Settings of the retries.

    Attributes:
        seconds: for which writing is tried.
        reopen: opens a new connection; ``None`` if that is impossible.
        announce: called once when the first try has failed.
    """

    seconds: float = 0.0
    reopen: Callable[[], Driver] | None = None
    announce: Callable[[], None] = lambda: None

    def put(self, driver: Driver | None, write: Callable[[Driver], object]) -> WriteOutcome:
        """Try to write until it succeeds or the time is over.

        Args:
            driver: open already; ``None`` opens one.
            write: writes the safe command through a driver.
        """
        begun, wait, failed, error = time.monotonic(), FIRST, 0, ""
        while True:
            try:
                driver = driver or self._fresh()
                write(driver)
                return WriteOutcome(driver, time.monotonic() - begun, error)
            except (Exception, SystemExit) as problem:  # a driver may raise anything
                error = f"{type(problem).__name__}: {problem}".rstrip(": ")
            failed += 1
            if failed == 1:
                self.announce()
            if failed >= SAME and self.reopen is not None and driver is not None:
                with contextlib.suppress(Exception):
                    driver.close()  # first close: many rigs allow one connection only
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
