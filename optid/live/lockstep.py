"""A session in one process and in simulated time, for studies, whose results must not depend on the machine."""

from __future__ import annotations

from collections.abc import Callable

from optid.live.clock import FastClock
from optid.live.driver import Driver
from optid.live.guard import End, Guard
from optid.live.log import Log
from optid.live.loop import Loop
from optid.live.messages import Reply, Sample


class Together:
    """A link to a loop that responds at once."""

    def __init__(self, loop: Loop) -> None:
        self._loop, self._reply = loop, None

    _reply: Reply | None

    def send(self, sample: Sample) -> None:
        """Let the loop work."""
        self._reply = self._loop.step(sample)

    def receive(self, number: int, timeout: float | None) -> Reply | None:
        """Its reply."""
        return self._reply


def run_lockstep(
    driver: Driver, loop: Loop, log: Log, seconds: float, asked: Callable[[], None] = lambda: None
) -> End:
    """Run a session's samples in sequence, with `asked` called before each; the driver and the log stay open."""
    settings = loop.settings
    guard = Guard(driver, Together(loop), FastClock(settings.span), loop.wiring, settings, log)
    return guard.run(round(seconds * settings.rate), asked)
