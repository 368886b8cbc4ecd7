"""Command and position sampled by two clocks that drift apart."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect
from optid.effects.late import command_ago

RATE = Parameter(
    "rate", "1", 1e-3, "share by which the position's clock gains on the command's; below 0 it loses",
    "crystals differ by 1e-5 to 2e-4, timers of a program by 1e-4 to 1e-2", 0.0, (-1e-2, 1e-2),
)  # fmt: skip


class ClockDrift(Effect):
    """Shown at t is the position of t - r t, with t from the start of each recording.

    Where the position comes late so does all that the command does: the command of r t ago is taken, exactly. Where
    it comes early it is carried on at its speed, x + v |r| t.
    """

    name = "clock_drift"
    sites = ("sensor.position", "valve.input")
    equation = "output"
    parameters = (RATE,)
    strength = {"rate": 5e-5}
    usual = ({"rate": 3e-4}, {"rate": 2e-3}, {"rate": -3e-4}, {"rate": -2e-3})
    law = "shown at t is the position of t - r t"
    says = "position and command are sampled by clocks that differ by {rate}: the position comes ever later, or earlier"
    depends_on = ("time", "velocity")
    needs = "fast motion late in a long recording"
    look_alikes = ("input_delay", "sensor_lag", "valve_lag", "sensor_drift")
    experiment = (
        "record command and position with one clock, or a step at the start and at the end of an hour"
    )
    source = "physics catalogue B.2: lag, gain and clock are the faults of data to rule out"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """What the sensor shows, m; the command as it was, a share of full command."""
        late = sheet.param(RATE) * sheet.clock()
        if site == "valve.input":
            return command_ago(sheet, nominal, ca.fmax(late, 0))
        return nominal - near["v"] * ca.fmin(late, 0)
