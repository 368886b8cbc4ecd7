"""A command that takes effect late: a bus, a converter, the run time of sound in a tube."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.delay import input_ago
from optid.effects.effect import Effect

DELAY = Parameter(
    "delay",
    "s",
    4e-3,
    "time from the command to its effect",
    "usual: 0.5 to 10 ms",
    0.0,
    (0.0, 0.1),
)


class InputDelay(Effect):
    """u(t - T_d), which switches inside a hold and has slopes in T_d."""

    name = "input_delay"
    sites = ("valve.input",)
    equation = "3-6"
    parameters = (DELAY,)
    strength = {"delay": 4e-4}
    usual = ({"delay": 1e-3}, {"delay": 3e-3}, {"delay": 8e-3})
    law = "the valve receives the command with a delay T_d"
    says = "the command takes effect with a delay of {delay}"
    depends_on = ("command_rate",)
    needs = "commands that change fast: steps, reversals, a binary sequence"
    look_alikes = ("valve_lag", "sensor_lag", "valve_rate_limit", "valve_hysteresis", "clock_drift")
    experiment = "record the spool's position signal, or the pressures at 5 kHz around steps of the command"
    # The skew between channels is within a sample; from position alone it cannot be distinguished from a delay.
    resolved = MappingProxyType({"delay": 0.5})
    source = "transport delay of bus, converter and tube"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The delayed command, a share of full command."""
        return input_ago(sheet, nominal, sheet.param(DELAY))
