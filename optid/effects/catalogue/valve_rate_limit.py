"""A spool that cannot move faster than its drive allows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

TIME = Parameter(
    "full_travel_time",
    "s",
    0.01,
    "time in which the spool at its fastest travels from the middle to full command",
    "usual: 0.1 to 2 m/s over 4 mm",
    0.0,
    (0.0, 0.2),
)
QUICK = 5e-4  # s: time constant for a small held command; a small change is followed at once


class ValveRateLimit(Effect):
    """s' = e / (t0 + T |e|) with e = command - s: at most 1/T; the spool is at s + t0 s', the command at T = 0."""

    name = "valve_rate_limit"
    sites = ("valve.command",)
    equation = "3-6"
    parameters = (TIME,)
    strength = {"full_travel_time": 1e-3}
    usual = ({"full_travel_time": 4e-3}, {"full_travel_time": 0.02})
    law = "the spool follows its command with a speed of at most 1 / T"
    says = "the spool needs {full_travel_time} for its full travel, however large the step"
    depends_on = ("command_rate",)
    needs = "large steps of the command"
    ahead_of = ("valve_saturation",)
    look_alikes = ("valve_lag", "input_delay", "valve_saturation", "sensor_lag")
    experiment = (
        "compare steps of 5 % and of 100 %: a lag takes the same time for both, a rate limit does not"
    )
    source = "slew rate of spool drives"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """Position of the spool, a share of full travel."""
        s = sheet.state("spool", "1", 0.1, spread=0.3)
        behind = nominal - s
        rate = behind / (QUICK + sheet.param(TIME) * ca.fabs(behind))
        sheet.rate(s, rate)
        return s + QUICK * rate
