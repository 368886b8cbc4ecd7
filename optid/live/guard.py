"""The guard: owns the driver, passes only allowed commands, and writes the safe one when anything fails.

It trusts no other process: the loop may hang, die or send nonsense. However a session ends, the safe command is
written before the driver is closed, and the log has every sample up to the last.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from optid.errors import JobError
from optid.live.clock import Clock
from optid.live.driver import Driver, EndOfData
from optid.live.failsafe import Failsafe
from optid.live.latency_histogram import LatencyHistogram
from optid.live.log import Layout, Log
from optid.live.messages import Link, LoopLost, Reply, Sample
from optid.live.motion_limiter import MotionLimiter
from optid.live.settings import Settings, Wiring

ANSWER = 0.8  # share of a period within which the loop must respond
ROUNDING = 0.01  # of the command's range: tolerated rounding of a converter
ABSURD = 10.0  # stroke limits' spans from their middle: a working sensor does not give such a position
NOWHERE = 1e6  # SI, the same where no stroke is known


class How(enum.Enum):
    """How a session ended."""

    DONE = "the requested time is over"
    ENDED = "the driver has no more samples"
    STOPPED = "stopped"
    FAILED = "failed"


class Stop(Exception):
    """The end of the session was requested."""


class Silence(JobError):
    """The watchdog: no command, or no measurement, for too long."""


@dataclass(frozen=True)
class End:
    """The end of a session.

    Attributes:
        how, why: the outcome and its reason.
        samples: taken.
        missed: missed deadlines: samples without a response in time, and samples that were not taken at all.
        held_back: samples in which a limit changed the loop's command.
        safe: whether the safe command was written.
        safe_after: s from the end of the samples until it was written; ``None`` if it could not be.
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
    safe_after: float | None = None


class ImplausibleReading(JobError):
    """A reading that a working sensor cannot give."""


@dataclass
class Tally:
    """Counters of a session."""

    samples: int = 0
    missed: int = 0
    held_back: int = 0
    lateness: LatencyHistogram = field(default_factory=LatencyHistogram)
    response: LatencyHistogram = field(default_factory=LatencyHistogram)
    numbers: LatencyHistogram = field(default_factory=LatencyHistogram)


class Guard:
    """Runs a session's samples.

    Args:
        driver: the access to the rig.
        link: to the loop.
        clock: the pace.
        wiring, settings: of the session.
        log: receives every sample.
        failsafe: settings of the retries of the safe command.

    Attributes:
        driver: in use; another one after a new connection for the safe command, ``None`` if none could be opened.
    """

    def __init__(
        self,
        driver: Driver,
        link: Link,
        clock: Clock,
        wiring: Wiring,
        settings: Settings,
        log: Log,
        failsafe: Failsafe | None = None,
    ) -> None:
        self.driver: Driver | None = driver
        self._driver, self._link, self._clock, self._log = driver, link, clock, log
        self._wiring, self._settings, self._limits = wiring, settings, settings.limits
        self._failsafe, self._fence = failsafe or Failsafe(), MotionLimiter(settings)
        self._standing = self._accepted = settings.limits.safe
        command, width = wiring.command, self._limits.high - self._limits.low
        resolution = abs(getattr(driver, "resolution", 0.0) * command.factor * command.per_unit)
        self._rounding = max(ROUNDING * width, resolution)
        self._layout = Layout(wiring)
        self._silent = 0.0  # s without a command or a measurement
        self.tally = Tally()

    def run(self, samples: int | None, asked: Callable[[], None] = lambda: None) -> End:
        """Take samples until the requested number, a stop, or a failure.

        Args:
            samples: number of samples; ``None`` for no end.
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
            how, why = How.FAILED, f"the loop process ended ({lost})"
        except (Silence, ImplausibleReading) as wrong:
            how, why = How.FAILED, str(wrong)
        except (Exception, SystemExit) as error:  # a driver may raise anything
            how, why = How.FAILED, f"{type(error).__name__}: {error}"
        after = self.make_safe()
        safe = after is not None
        t = self.tally
        timing = {
            "lateness": t.lateness.summary(),
            "response": t.response.summary(),
            "numbers": t.numbers.summary(),
        }
        return End(
            how,
            why if safe else f"{why}; the safe command could not be written",
            t.samples,
            t.missed,
            t.held_back,
            safe,
            timing,
            after,
        )

    def make_safe(self) -> float | None:
        """Write the safe command; s until a driver accepted it, ``None`` if none did."""
        safe = self._wiring.put(self._limits.safe)
        done = self._failsafe.put(self.driver, lambda driver: driver.write(safe, self._clock.now()))
        self.driver = done.driver
        return done.seconds

    def _sample(self, number: int) -> int:
        """Take one sample; returns the number of the next one."""
        clock, limits, tally = self._clock, self._limits, self.tally
        begun = clock.wait(number)
        values, measured = self._read(begun)
        self._link.send(Sample(number, begun, self._standing, self._accepted, values))
        reply = self._link.receive(number, clock.left(number, ANSWER))
        if reply is None:
            tally.missed += 1
            command = limits.safe
        else:
            wish = self._fence.held(begun, measured, reply.command)
            command = limits.allowed(wish, self._accepted, measured, self._settings.span)
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
            ):  # times increase; every sample without a measurement has its row
                self._write_down(due, (math.nan,) * len(values), None)
            following += 1
            tally.missed += 1
        return following

    def _read(self, time: float) -> tuple[Sequence[float], float]:
        """The driver's values in the units of the columns, and the position, SI."""
        values, channels = self._driver.read(time), self._wiring.measured
        if len(values) != len(channels):
            raise JobError(
                f"the driver read {len(values)} values; expected {', '.join(c.role for c in channels)}"
            )
        for value, channel in zip(values, channels, strict=True):
            if math.isinf(value):
                raise ImplausibleReading(f"{channel.role} reads {value:g}")
        position, (low, high) = channels[0], self._limits.stroke
        measured = position.factor * values[0] + position.shift
        known = math.isfinite(high - low)
        middle, most = ((low + high) / 2, ABSURD * (high - low)) if known else (0.0, NOWHERE)
        if abs(measured - middle) > most:
            raise ImplausibleReading(
                f"{position.role} reads {measured:g} {position.recorded_unit}, far beyond the stroke"
            )
        return values, measured

    def _put(self, command: float) -> None:
        wiring = self._wiring
        taken = wiring.taken(self._driver.write(wiring.put(command), self._clock.now()))
        self._standing, self._accepted = taken, taken if abs(taken - command) > self._rounding else command

    def _watch(self, answered: bool, measured: bool) -> None:
        self._silent = 0.0 if answered and measured else self._silent + self._settings.span
        if self._silent > self._settings.watchdog:
            what = "the position sensor gives no value" if answered else "the loop does not respond"
            raise Silence(f"{what} for {self._silent:.3g} s")

    def _write_down(self, time: float, values: Sequence[float], reply: Reply | None) -> None:
        self._log.row(self._layout.row(time, self._standing, values, reply))
