"""The plan of a session, and the layout of its signals for the other processes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from optid.armax.offline import names
from optid.armax.structure import Orders
from optid.live.driver import VIRTUAL
from optid.live.excitation import AHEAD
from optid.live.loop import Choices
from optid.live.reference import Reference
from optid.live.settings import Settings, live_settings
from optid.rigs.rigfile import Rig

# Columns of the ring of signals, one row per sample, SI.
SIGNALS = (
    "time",
    "reference",
    "measured",
    "predicted",
    "simulated",
    "windowed",
    "command",
    "innovation",
)
KEEP = 60.0  # s of signals in the ring
# Maximum sensitivity of a tuned loop. Åström and Hägglund (Advanced PID Control, 2006, sec. 4.6) name 1.2 to 2.0;
# its low end because a linear model has neither friction nor valve: studies/mixed_reality.py shows the cost.
ROOM = 1.2
SLOW = 20.0  # Hz: rate of the parameters' ring buffer, and of everything other than signals


@dataclass(frozen=True)
class Plan:
    """A session.

    Attributes:
        rig: path of the rig file.
        driver: built-in name or "file.py:function".
        out: folder for the log.
        reference: demanded position.
        choices: gains, orders, dither.
        seconds: duration; ``None`` until it is stopped.
        rate: Hz; ``None`` for the rig file's.
        fast: as fast as possible instead of in real time.
        hold: s of a fast session after which it waits to be resumed; ``None`` never.
        recording: for `replay`.
        seed: of everything random.
        since: live.json of an earlier session for comparison; ``None`` for the rig file.
        sensitivity: largest maximum sensitivity of tuned gains on the identified model.
    """

    rig: Path
    driver: str
    out: Path
    reference: Reference
    choices: Choices
    seconds: float | None = None
    rate: float | None = None
    fast: bool = False
    recording: Path | None = None
    seed: int = 0
    sensitivity: float = ROOM
    hold: float | None = None
    since: Path | None = None


def session_settings(plan: Plan, rig: Rig) -> Settings:
    """Rate, limits and watchdog of a session."""
    settings = live_settings(rig, plan.rate, relaxed=plan.driver in VIRTUAL)
    return settings if plan.choices.command is None else replace(settings, ahead=AHEAD)


def slow_columns(orders: Orders) -> list[str]:
    """Columns of the ring of parameters: time, fit percent, whether rig and model disagree, noise sd, and theta."""
    return ["time", "fit_percent", "disagree", "noise_sd", *names(orders)]


def ring_sizes(plan: Plan, rate: float) -> tuple[tuple[int, int], tuple[int, int]]:
    """Rows and columns of the ring of signals and of the ring of parameters."""
    return (round(KEEP * rate), len(SIGNALS)), (round(KEEP * SLOW), len(slow_columns(plan.choices.orders)))
