"""End stops of a stroke and the sampling skew of a data acquisition card: common to all axes with a stroke."""

from __future__ import annotations

from typing import Any

import casadi as ca

from optid.core.parameter import Nuisance, Parameter
from optid.core.sheet import Sheet

SAMPLING_SKEW = Parameter(
    "sampling_skew",
    "s",
    1e-4,
    "time by which the position's samples are older than the command's, a fraction of one sample",
    "no card samples and writes at one instant; longer lags are physics",
    0.0,
    (-5e-4, 5e-4),
    nuisance=Nuisance(sd=2e-4),
)
STOP_STIFFNESS = Parameter(
    "stop_stiffness",
    "N/m**1.5",
    1e8,
    "Hunt-Crossley stiffness of the stroke's ends",
    "steel on a rubber buffer: 0.3 mm under 500 N",
    1e8,
    (1e3, 1e13),
)
STOP_DAMPING = Parameter(
    "stop_damping",
    "s/m",
    2.0,
    "Hunt-Crossley damping of the stroke's ends",
    "restitution of about 0.2",
    2.0,
    (0.0, 1e3),
)


def end_stops(s: Sheet, x: Any, v: Any, L: Any) -> Any:
    """Contact force of the stroke's ends, N: Hunt and Crossley's law with exponent 3/2, never adhesive."""
    depth_low, depth_high = ca.fmax(-L / 2 - x, 0), ca.fmax(x - L / 2, 0)
    k, c = s.param(s.sized(STOP_STIFFNESS)), s.param(STOP_DAMPING)
    push_low = k * depth_low * ca.sqrt(depth_low + 1e-12) * ca.fmax(1 - c * v, 0)
    push_high = k * depth_high * ca.sqrt(depth_high + 1e-12) * ca.fmax(1 + c * v, 0)
    return push_low - push_high
