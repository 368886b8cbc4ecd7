"""A user's own plant: two cascaded tanks that run over, the upper one partly into the lower one.

A rig file names it as `model = "overflow_tanks.py:overflow_tanks"`. Levels in volts of the lower tank's sensor; the
upper level is not measured, so that its scale is free: the upper tank runs over at 10 V, and that is its scale.

    h_1' = k_4 u - q_1 - o_1              q_1 = k_1 h_1^e_1             o_1 = w_1 max(h_1 - 10, 0)^1.5
    h_2' = a (q_1 + s o_1) - q_3 - o_2    q_3 = k_3 (h_2 - z)^e_3       o_2 = w_2 max(h_2 - r, 0)^1.5

An orifice drains by e = 1/2 (Torricelli), a narrow pipe by e = 1 (Hagen and Poiseuille), one with a long drop below it
hardly by level at all. A rim passes the power 1.5 of the height above it (Poleni). z is what the sensor shows of an
empty tank.
"""

from __future__ import annotations

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.core.smooth import soft_floor

GUESS = "a start value for the fit; no data sheet exists"
RIM = 10.0  # V: the upper level's scale
ROUND = 0.05  # V: half the range of levels over which an overflow begins; 0.0125 V of error at most
EMPTY = 0.05  # V: of a level near nothing; at 1 V the flow is 0.06 % high


def _stated(name: str, unit: str, usual: float, what: str, bounds: tuple[float, float]) -> Parameter:
    return Parameter(name, unit, usual, what, GUESS, bounds=bounds)


PUMP = _stated("pump_gain", "1/s", 0.05, "upper rate per volt of the pump", (0.0, 1.0))
RATIO = _stated("area_ratio", "1", 1.0, "of the upper tank's area to the lower's", (0.01, 100.0))
CAUGHT = _stated("caught", "1", 0.5, "share of the upper overflow that the lower tank gets", (0.0, 1.0))
EMPTY_READING = _stated(
    "empty_reading", "V", 1.0, "what the sensor shows of an empty lower tank", (-10.0, 10.0)
)
LOWER_RIM = _stated("lower_rim", "V", 10.0, "level at which the lower tank runs over", (1.0, 20.0))


def overflow_tanks(s: Sheet) -> None:
    """Pump command (V) -> upper level -> lower level (V), with both outlets' laws and an overflow of each tank."""
    h_1 = s.state("upper_level", "V", 5.0, start=5.0, spread=3.0)
    h_2 = s.state("lower_level", "V", 5.0, start=5.0)
    falling = _outlet(s, "upper", h_1)
    over = _weir(s, "upper", h_1 - RIM)
    s.rate(h_1, s.param(PUMP) * s.input("command", "V") - falling - over)
    leaving = _outlet(s, "lower", h_2 - s.param(EMPTY_READING)) + _weir(s, "lower", h_2 - s.param(LOWER_RIM))
    s.rate(h_2, s.param(RATIO) * (falling + s.param(CAUGHT) * over) - leaving)
    s.output("level", "V", -soft_floor(-h_2, -10.0, 0.02))  # the sensor ends at 10 V


def _outlet(s: Sheet, tank: str, head: ca.SX) -> ca.SX:
    """Outflow, V/s; the head counts in volts, so that the rate's unit does not depend on the power."""
    rate = s.param(_stated(f"{tank}_outlet", "V/s", 0.05, f"outflow of the {tank} tank at 1 V", (0.0, 10.0)))
    power = s.param(_stated(f"{tank}_power", "1", 0.5, f"of the head in the {tank} outflow", (0.05, 2.0)))
    return rate * ((head + ca.sqrt(head**2 + EMPTY**2)) / 2) ** power


def _weir(s: Sheet, tank: str, above: ca.SX) -> ca.SX:
    """Flow over a rim, V/s."""
    weir = s.param(_stated(f"{tank}_weir", "V/s", 0.3, f"overflow of the {tank} tank at 1 V", (0.0, 100.0)))
    return weir * soft_floor(above, 0.0, ROUND) ** 1.5
