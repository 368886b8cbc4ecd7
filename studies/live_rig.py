"""A driver for `optid live` that a user could have written: the rig of `studies.independent_rig` behind it.

    optid live data/bench.toml --driver studies/live_rig.py:rig --out out/live

The rig shares no line with optid: stick-slip that fades with speed, a valve of second order, a leak, an uneven
track. The model of data/bench.toml has none of these, and four of its numbers are off.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))  # the studies are no package: find their neighbours from any folder

from studies.independent_rig import Rig  # noqa: E402
from studies.independent_rig.loop import interval, state  # noqa: E402
from studies.independent_rig.rig import balanced, packed  # noqa: E402
from studies.independent_rig.sensor import reading  # noqa: E402
from studies.independent_rig.states import SMOOTH  # noqa: E402

REAL = Rig(
    viscous=61.3,
    coulomb=71.4,
    discharge=0.733,
    residual_length=9.2e-3,
    stick_ratio=1.15,
    stribeck_speed=0.03,
    asymmetry=0.03,
    valve_order=2.0,
    valve_frequency=500.0,
    leak_a=5e-9,
)
STEP = 20e-6  # s of its integration
NOISE, QUANTUM = 0.03e-3, 10.0 / 4096  # m of the sensor, V of the converter
FULL = 5.0  # V


class LiveRig:
    """`read` and `write` as `optid.live.driver` wants them; values as data/bench.toml's columns hold them: mm and V."""

    def __init__(self, real: Rig, seed: int) -> None:
        self._rig, self._y = packed(real), state(real, balanced(real))
        self._work = (np.zeros((6, SMOOTH)), SMOOTH)
        self._rng, self._share, self._time = np.random.default_rng(seed), np.zeros(1), 0.0
        self._reach(STEP)  # compiles now

    def read(self, time: float) -> list[float]:
        """The position, mm."""
        self._reach(time)
        seen = reading(self._rig, time, self._y, self._share[0]) + NOISE * self._rng.standard_normal()
        return [1e3 * seen]

    def write(self, command: float, time: float) -> float:
        """The command, V, through a converter of 12 bits."""
        self._reach(time)
        volts = QUANTUM * round(command / QUANTUM)
        self._share[0] = volts / FULL
        return volts

    def close(self) -> None:
        """Nothing to close."""

    def _reach(self, time: float) -> None:
        left = time - self._time
        if left > 0.0:
            interval(self._rig, self._y, self._share, (0, left, math.ceil(left / STEP), 0), self._work)
            self._time = time


def rig(order: Any) -> LiveRig:
    """The driver."""
    return LiveRig(REAL, order.seed)
