"""What a session is to do, and its signals as the other processes see them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from optid.armax.offline import names
from optid.armax.structure import Orders
from optid.live.loop import Choices
from optid.live.reference import Reference

# Columns of the ring of signals, one row a sample, SI.
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
SLOW = 20.0  # Hz: the pace of the parameters' ring, and of everything that is no signal


@dataclass(frozen=True)
class Plan:
    """A session.

    Attributes:
        rig: path of the rig file.
        driver: built-in name or "file.py:function".
        out: folder for the log.
        reference: demanded position.
        choices: gains, orders, dither.
        seconds: how long; ``None`` until it is stopped.
        rate: Hz; ``None`` for the rig file's.
        fast: as fast as it goes instead of by the clock.
        recording: for `replay`.
        seed: of everything random.
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


def slow_columns(orders: Orders) -> list[str]:
    """Columns of the ring of parameters: time, fit percent, parted or not, noise sd, and theta."""
    return ["time", "fit_percent", "parted", "noise_sd", *names(orders)]


def ring_sizes(plan: Plan, rate: float) -> tuple[tuple[int, int], tuple[int, int]]:
    """Rows and columns of the ring of signals and of the ring of parameters."""
    return (round(KEEP * rate), len(SIGNALS)), (round(KEEP * SLOW), len(slow_columns(plan.choices.orders)))
