"""A command that takes effect late: a bus, a converter, a tube's run of sound."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

DELAY = Parameter(
    "delay", "s", 4e-3, "time from the command to its effect", "physics catalogue A.2: 0.5 to 10 ms",
    0.0, (0.0, 0.1),
)  # fmt: skip
# Samples ago that are looked up: every one for short delays, fewer for long ones. A delay beyond the last counts
# as the last: 12 ms at 5 kHz, 64 ms at 1 kHz.
TAPS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 16, 24, 40, 64)


class InputDelay(Effect):
    """u(t - T_d), its mean over each sample: straight lines between the held values, so that it has slopes in T_d."""

    name = "input_delay"
    sites = ("valve.input",)
    equation = "3-6"
    parameters = (DELAY,)
    strength = {"delay": 4e-4}
    usual = ({"delay": 1e-3}, {"delay": 3e-3}, {"delay": 8e-3})
    law = "the valve receives the command of T_d ago"
    says = "the command takes effect {delay} late"
    depends_on = ("command_rate",)
    needs = "commands that change fast: steps, reversals, a binary sequence"
    look_alikes = ("valve_lag", "sensor_lag", "valve_rate_limit", "valve_hysteresis")
    experiment = "record the spool's position signal, or the pressures at 5 kHz around steps of the command"
    source = "physics D.6; sizes from physics catalogue A.2, row 21"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The command as it was, a share of full command."""
        ago = sheet.param(DELAY) / sheet.interval()
        held = [nominal, *(sheet.past("command", k) for k in TAPS[1:])]
        late = nominal
        for k, left, right in zip(range(len(TAPS)), TAPS, TAPS[1:], strict=False):
            way = (ago - left) / (right - left)
            # Without a floor at 0 for the first, so that the slope at the null is that of the right side.
            share = ca.fmin(way if k == 0 else ca.fmax(way, 0), 1)
            late = late + share * (held[k + 1] - held[k])
        return late
