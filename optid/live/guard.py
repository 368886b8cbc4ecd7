"""The guard: holds the rig's door, lets only allowed commands through, and puts the safe one when anything fails.

It trusts nobody: the loop may hang, die or send nonsense. Whatever ends a session, the safe command is put before
the driver is closed, and the log holds every sample up to the last.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from optid.errors import JobError
from optid.live.clock import Clock
from optid.live.driver import Driver, EndOfData
from optid.live.log import Layout, Log
from optid.live.messages import Link, LoopLost, Reply, Sample
from optid.live.settings import Settings, Wiring
from optid.live.timing import Durations

ANSWER = 0.8  # share of a period within which the loop must have answered
TRIES = 3  # to put the safe command


class How(enum.Enum):
    """How a session ended."""

    DONE = "the time is over"
    ENDED = "the driver has no more samples"
    STOPPED = "stopped"
    FAILED = "failed"


class Stop(Exception):
    """Somebody asked for the end."""


class Silence(JobError):
    """The watchdog: no command, or no measurement, for too long."""


@dataclass(frozen=True)
class End:
    """What a session came to.

    Attributes:
        how, why: the outcome, and what led to it.
        samples: taken.
        missed: deadlines: samples without an answer in time, and samples that were not taken at all.
        held_back: samples in which a limit changed the loop's wish.
        safe: the safe command stands; False where it could not be put.
        timing: summaries of "lateness" (of samples, from their due time), "response" (from a sample to its
            command) and "numbers" (of the loop).
    """

    how: How
    why: str
    samples: int
    missed: int
    held_back: int
    safe: bool
    timing: dict[str, dict[str, float | int] | None]


@dataclass
class Tally:
    """What is counted on the way."""

    samples: int = 0
    missed: int = 0
    held_back: int = 0
    lateness: Durations = field(default_factory=Durations)
    response: Durations = field(default_factory=Durations)
    numbers: Durations = field(default_factory=Durations)


class Guard:
    """Runs a session's samples.

    Args:
        driver: the door to the rig.
        link: to the loop.
        clock: the pace.
        wiring, settings: of the session.
        log: gets every sample.
    """

    def __init__(
        self, driver: Driver, link: Link, clock: Clock, wiring: Wiring, settings: Settings, log: Log
    ) -> None:
        self._driver, self._link, self._clock, self._log = driver, link, clock, log
        self._wiring, self._settings, self._limits = wiring, settings, settings.limits
        self._standing = settings.limits.safe
        self._layout = Layout(wiring)
        self._silent = 0.0  # s without a command or a measurement
        self.tally = Tally()

    def run(self, samples: int | None, asked: Callable[[], None] = lambda: None) -> End:
        """Take samples until they are all taken, somebody stops it, or something fails.

        Args:
            samples: how many; ``None`` for no end.
            asked: called before each sample; raises `Stop` to end the session.
        """
        number, how, why = 0, How.DONE, How.DONE.value
        try:
            self._put(self._limits.safe)
            self._clock.begin()
            while samples is None or number < samples:
                asked()
                number = self._sample(number)
        except EndOfData as end:
            how, why = How.ENDED, str(end) or How.ENDED.value
        except Stop as stop:
            how, why = How.STOPPED, str(stop)
        except LoopLost as lost:
            how, why = How.FAILED, f"the loop has gone ({lost})"
        except Silence as silence:
            how, why = How.FAILED, str(silence)
        except Exception as error:  # whatever a driver raises
            how, why = How.FAILED, f"{type(error).__name__}: {error}"
        safe = self.make_safe()
        t = self.tally
        timing = {
            "lateness": t.lateness.summary(),
            "response": t.response.summary(),
            "numbers": t.numbers.summary(),
        }
        return End(
            how,
            why if safe else f"{why}; the safe command could not be put",
            t.samples,
            t.missed,
            t.held_back,
            safe,
            timing,
        )

    def make_safe(self) -> bool:
        """Put the safe command; True once the driver took it."""
        for _ in range(TRIES):
            try:
                self._put(self._limits.safe)
                return True
            except Exception:
                continue
        return False

    def _sample(self, number: int) -> int:
        """Take one sample; the number of the next one that is still to come."""
        clock, limits, tally = self._clock, self._limits, self.tally
        begun = clock.wait(number)
        values = self._driver.read(begun)
        position = self._wiring.measured[0]
        measured = position.factor * values[0] + position.shift
        self._link.send(Sample(number, begun, self._standing, values))
        reply = self._link.receive(number, clock.left(number, ANSWER))
        if reply is None:
            tally.missed += 1
            command = limits.safe
        else:
            command = limits.allowed(reply.command, self._standing, measured, self._settings.span)
            tally.held_back += abs(command - reply.command) > 1e-9 * (limits.high - limits.low)
            tally.numbers.add(reply.seconds)
        self._put(command)
        done = clock.now()
        self._watch(reply is not None, math.isfinite(measured))
        self._write_down(begun, values, reply)
        tally.samples += 1
        tally.lateness.add(begun - number * self._settings.span)
        tally.response.add(done - begun)
        following = number + 1
        while clock.left(following, 1.0) == 0.0:  # its whole period has passed: a row without a measurement
            due = following * self._settings.span
            if (
                due > begun or not self._wiring.time.column
            ):  # times increase; without any, every sample has its row
                self._write_down(due, (math.nan,) * len(values), None)
            following += 1
            tally.missed += 1
        return following

    def _put(self, command: float) -> None:
        wiring = self._wiring
        self._standing = wiring.taken(self._driver.write(wiring.put(command), self._clock.now()))

    def _watch(self, answered: bool, measured: bool) -> None:
        self._silent = 0.0 if answered and measured else self._silent + self._settings.span
        if self._silent > self._settings.watchdog:
            what = "the position sensor shows nothing" if answered else "the loop does not answer"
            raise Silence(f"{what} for {self._silent:.3g} s")

    def _write_down(self, time: float, values: Sequence[float], reply: Reply | None) -> None:
        self._log.row(self._layout.row(time, self._standing, values, reply))
