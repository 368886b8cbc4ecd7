"""A user's own plant: two cascaded tanks whose upper one runs over, part of it into the lower one.

A rig file names it as `model = "overflow_tanks.py:overflow_tanks"`; levels in volts of the lower tank's sensor.
"""

from __future__ import annotations

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.core.smooth import signed_root, soft_floor

GUESS = "a start value for the fit; no data sheet exists"
RIM = Parameter("rim", "V", 10.0, "level at which a tank runs over", GUESS, bounds=(0.1, 100.0))
CAUGHT = Parameter(
    "caught", "1", 0.5, "share of the upper overflow the lower tank gets", GUESS, bounds=(0.0, 5.0)
)
WEIR = Parameter("weir", "1/s", 0.5, "rate of overflow per volt above the rim", GUESS, 0.5, (1e-3, 100.0))
ROUND = 0.05  # V: half the range of levels over which an overflow begins; 0.0125 V of error at most


def _drain(name: str, description: str) -> Parameter:
    return Parameter(name, "V**0.5/s", 0.05, description, GUESS, bounds=(0.0, 1e3))


def overflow_tanks(s: Sheet) -> None:
    """Pump command (V) -> upper level -> lower level (V), with a pipe loss and an overflow of each tank."""
    h_1 = s.state("upper_level", "V", 5.0, start=5.0, spread=3.0)
    h_2 = s.state("lower_level", "V", 5.0, start=5.0)
    u = s.input("command", "V")
    pump = s.param(
        Parameter("pump_gain", "1/s", 0.05, "upper rate per volt of the pump", GUESS, bounds=(0.0, 1e3))
    )
    leaving = s.param(_drain("upper_outlet", "upper outflow")) * signed_root(h_1, 0.02)
    arriving = s.param(_drain("lower_inlet", "the same in the lower tank")) * signed_root(h_1, 0.02)
    draining = s.param(_drain("lower_outlet", "lower outflow")) * signed_root(h_2, 0.02)
    over_1, over_2 = (s.param(WEIR) * _above(h, s.param(RIM)) for h in (h_1, h_2))
    s.rate(h_1, pump * u - leaving - over_1)
    s.rate(h_2, arriving - draining + s.param(CAUGHT) * over_1 - over_2)
    s.output("level", "V", -soft_floor(-h_2, -10.0, 0.02))  # the sensor ends at 10 V


def _above(level: ca.SX, rim: ca.SX) -> ca.SX:
    return soft_floor(level - rim, 0.0, ROUND)
