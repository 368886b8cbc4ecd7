"""Play between the axis and its position sensor: a rack and pinion, a loose coupling."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.core.smooth import dead_zone
from optid.effects.effect import Effect

PLAY = Parameter(
    "play",
    "m",
    1e-4,
    "half the clearance: the sensor lags by this in both directions",
    "usual: 0.02 to 0.3 mm",
    0.0,
    (0.0, 5e-3),
)
# s: relaxation time of the play; it shortens a reversal by the braking distance in that time: 1 um at 10 m/s2.
CATCH = 3e-4


class SensorBacklash(Effect):
    """The play operator, with the lead of the axis over the sensor's gear as state; `ahead` stays within +- play."""

    name = "sensor_backlash"
    sites = ("sensor.position",)
    equation = "output"
    parameters = (PLAY,)
    strength = {"play": 1e-5}
    usual = ({"play": 5e-5}, {"play": 2e-4})
    law = "the sensor lags the axis by the play, and does not move while a reversal takes it up"
    says = "the position sensor has a play of {play} to either side"
    depends_on = ("velocity",)
    needs = "reversals"
    ahead_of = ("sensor_lag", "clock_drift")
    look_alikes = ("presliding", "valve_hysteresis", "sensor_lag", "compliant_load")
    experiment = "approach one point from both sides, against a dial gauge"
    source = "play (backlash) operator, as a relaxation with its own state"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The sensor's reading, m."""
        play = sheet.param(PLAY)
        ahead = sheet.state("ahead", "m", 1e-4, spread=1e-3)
        beyond = dead_zone(ahead, play)
        sheet.rate(ahead, near["v"] - beyond / CATCH)
        sheet.override_signal("v", near["v"] * (ca.fabs(ahead) >= play))
        return nominal - (ahead - beyond)
