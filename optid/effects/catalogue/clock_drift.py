"""Command and position sampled by two clocks that drift apart."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.delay import input_ago
from optid.effects.effect import Effect

RATE = Parameter(
    "rate",
    "1",
    1e-3,
    "share by which the position's clock gains on the command's; below 0 it loses",
    "crystals differ by 1e-5 to 2e-4, timers of a program by 1e-4 to 1e-2",
    0.0,
    (-1e-2, 1e-2),
)

OTHERS = Parameter(
    "others",
    "1",
    0.5,
    "share of the position's delay that all other channels have as well",
    "one data acquisition card or several",
    1.0,
    (0.0, 1.0),
)
# s: keeps the equations from becoming stiff at the null; any speed is nearly constant over this time.
SHORTEST = 1e-3
# m: travel of a piston during the clocks' difference, and its sd at the start of a recording. With speeds instead of
# distances they would have to be known far better than so short a time shows them.
USUAL, SPREAD = 1e-2, 5e-5


class ClockDrift(Effect):
    """Shown at t is the position of t - r t, with t from the start of each recording.

    Where position and other channels are late together, everything follows the command late: the command is delayed by
    r t, exactly. A lag of the position alone is its travel in the last r t seconds, by Pade's approximation of
    third order: the piston may have broken away in between, which its present speed and acceleration do not show.
    A lead is extrapolated, x - v r t + a (r t)^2 / 2.
    """

    name = "clock_drift"
    sites = ("sensor.position", "valve.input")
    equation = "output"
    parameters = (RATE, OTHERS)
    strength = {"rate": 5e-5}
    usual = (
        {"rate": 3e-4, "others": 1.0},
        {"rate": 2e-3, "others": 1.0},
        {"rate": 3e-4, "others": 0.0},
        {"rate": 2e-3, "others": 0.0},
        {"rate": -3e-4, "others": 1.0},
        {"rate": -2e-3, "others": 1.0},
    )
    law = "the recorded value at t is the position at t - r t"
    says = (
        "position and command are sampled by clocks that differ by {rate}: the position comes later and later, "
        "or earlier and earlier; the other channels share {others} of that"
    )
    depends_on = ("time", "velocity")
    needs = "fast motion late in a long recording"
    look_alikes = ("input_delay", "sensor_lag", "valve_lag", "sensor_drift")
    experiment = (
        "record command and position with one clock, or a step at the start and at the end of an hour"
    )
    source = "two sampling clocks that are not synchronised"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The sensor's reading, m; the delayed command, a share of full command."""
        late = sheet.param(RATE) * sheet.clock()
        together = sheet.param(OTHERS) * ca.fmax(late, 0)
        if site == "valve.input":
            return input_ago(sheet, nominal, together)
        alone, v = late - together, near["v"]
        long = ca.fmax(alone, SHORTEST)
        longer = ca.if_else(alone > SHORTEST, sheet.param(RATE) * (1 - sheet.param(OTHERS)), 0)
        way, change, bend = (
            sheet.state(name, "m", USUAL, spread=SPREAD) for name in ("way", "way_change", "way_bend")
        )
        # The mean speed of that time, by (120 + 2 s^2) / (120 + 60 s + 12 s^2 + s^3) with s in that time, times it.
        sheet.rate(way, (longer * way + change) / long)
        sheet.rate(change, (longer * change + bend) / long)
        sheet.rate(bend, (120 * (v * long - way) - 60 * change + (longer - 12) * bend) / long)
        moved = way + bend / 60
        early = nominal - v * alone + near.get("a", 0.0) * alone**2 / 2
        return ca.if_else(alone > 0, nominal - moved * alone / long, early)
