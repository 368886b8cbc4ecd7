"""Two tanks, one above the other: a pump fills the upper, which drains into the lower, which drains away.

Equations and names follow the "Cascaded tanks benchmark combining soft and hard nonlinearities" (Schoukens,
Mattsson, Wigren and Noël, workshop on nonlinear system identification benchmarks, 2016), levels in volts of
the level sensor:

    h_1' = -k_1 sqrt(h_1) + k_4 u
    h_2' = +k_2 sqrt(h_1) - k_3 sqrt(h_2)

The benchmark's rig also overflows at the upper tank; that is left to an effect at `store.upper`.
"""

from __future__ import annotations

from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.core.smooth import signed_root, soft_floor

TANKS = "Schoukens, Mattsson, Wigren and Noël, cascaded tanks benchmark, 2016"
DRAIN = (0.0, 1e3)

UPPER_OUTLET = Parameter(
    "upper_outlet",
    "V**0.5/s",
    0.05,
    "outflow of the upper tank as a rate of its level, k_1",
    TANKS,
    bounds=DRAIN,
)
LOWER_INLET = Parameter(
    "lower_inlet",
    "V**0.5/s",
    0.05,
    "the same flow as a rate of the lower tank's level, k_2",
    TANKS,
    bounds=DRAIN,
)
LOWER_OUTLET = Parameter(
    "lower_outlet",
    "V**0.5/s",
    0.05,
    "outflow of the lower tank as a rate of its level, k_3",
    TANKS,
    bounds=DRAIN,
)
PUMP_GAIN = Parameter(
    "pump_gain", "1/s", 0.05, "rate of the upper level per volt of the pump, k_4", TANKS, bounds=(-1e3, 1e3)
)

# Settings: smoothing of an empty tank and of a saturated sensor.
EMPTY_WIDTH = Parameter(
    "empty_width",
    "V",
    0.02,
    "level below which the square root of Torricelli's law gives way to a line",
    "numerical: the flow is 1 % low at 5 widths, 0.01 % at 50",
    0.02,
    (1e-6, 1.0),
)
SENSOR_CEILING = Parameter(
    "sensor_ceiling", "V", 10.0, "level at which the sensor saturates", TANKS, 10.0, (0.1, 1e3)
)
CEILING_WIDTH = Parameter(
    "ceiling_width",
    "V",
    0.02,
    "half the range of levels over which the sensor goes into saturation",
    "numerical: shows at most a quarter of this too little, and the truth outside",
    0.02,
    (1e-6, 1.0),
)


def cascaded_tanks(s: Sheet) -> None:
    """Pump command (V) -> upper level -> lower level (V).

    Three sites carry flows over the rims, in V/s and zero here: `store.upper` leaves the upper tank,
    `store.caught` is the part of it that the lower tank receives (all, unless an effect says otherwise), and
    `store.lower` leaves the lower tank.
    """
    h_1, h_2 = (
        s.state("upper_level", "V", 5.0, start=5.0, spread=3.0),
        s.state("lower_level", "V", 5.0, start=5.0),
    )
    u = s.site("flow.command", s.input("command", "V"), unit="V", size=5.0)
    inlet = s.site("flow.inlet", s.param(PUMP_GAIN) * u, unit="V/s", size=0.2, u=u, h_1=h_1)
    root_1, root_2 = (signed_root(h, s.param(EMPTY_WIDTH)) for h in (h_1, h_2))
    # One flow in two scales: the tanks need not be equally wide, so an effect acts on their common part.
    between = s.site("flow.between", root_1, unit="V**0.5", size=2.0, h_1=h_1, h_2=h_2)
    outlet = s.site("flow.outlet", s.param(LOWER_OUTLET) * root_2, unit="V/s", size=0.1, h_2=h_2)

    fill = inlet - s.param(UPPER_OUTLET) * between
    over = s.site("store.upper", 0.0, unit="V/s", level=h_1, h_1=h_1, u=u, fill=fill)
    caught = s.site("store.caught", over, unit="V/s", h_1=h_1, h_2=h_2)
    refill = s.param(LOWER_INLET) * between + caught - outlet
    s.rate(h_1, fill - over)
    s.rate(h_2, refill - s.site("store.lower", 0.0, unit="V/s", level=h_2, h_2=h_2, fill=refill))
    s.output("level", "V", s.site("sensor.level", saturated(s, h_2), unit="V", size=5.0, h_2=h_2))


def saturated(s: Sheet, level: Any) -> Any:
    """Reading of a saturating sensor for a level, V."""
    return -soft_floor(-level, -s.param(SENSOR_CEILING), s.param(CEILING_WIDTH))
