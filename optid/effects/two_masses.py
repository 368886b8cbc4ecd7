"""An elastic transmission: motor and load as two masses, where the rigid axis has one."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.sheet import Sheet

SITES = ("force.shaft_angle", "force.shaft_speed", "force.transmission")
# rad/s: natural frequency of the two masses; faster ones are rigid for any drive.
STIFFEST = 2 * math.pi * 120.0


def blend(size: Any, least: Any) -> Any:
    """0 for a size of 0 and 1 from `least` on, with a slope at 0: below it the law is mixed with the rigid one."""
    share = ca.fmin(size / least, 1)
    return share * (2 - share)


def reduced(near: Mapping[str, Any]) -> Any:
    """Inertia of motor and load against each other."""
    motor, load = _inertias(near)
    return motor * load / (motor + load)


def _inertias(near: Mapping[str, Any]) -> tuple[Any, Any]:
    return near["motor"], ca.fmax(near["load"], 1e-3 * near["motor"])


def motor_side(sheet: Sheet, site: str, nominal: Any, counts: Any) -> Any:
    """Angle or speed of the motor's shaft, as the output turns, from that of the load; `counts` is not rigid."""
    if site == SITES[0]:
        sheet.store("twist", sheet.state("twist", "m", 1e-4, spread=5e-4))
        sheet.store("rate", sheet.state("twist_rate", "m/s", 0.01, spread=0.05))
        return nominal + counts * sheet.recall("twist")
    return nominal + counts * sheet.recall("rate")


def transmitted(sheet: Sheet, nominal: Any, near: Mapping[str, Any], counts: Any, effort: Any) -> Any:
    """Acceleration of the load behind a shaft that transmits an effort; `counts` is the share that is not rigid.

    J_m a_m = driven - T, J_l a_l = loaded + T, and the twist is the motor's way ahead of the load.
    """
    motor, load = _inertias(near)
    behind = (near["loaded"] + effort) / load
    sheet.rate(sheet.recall("twist"), sheet.recall("rate"))
    sheet.rate(sheet.recall("rate"), (near["driven"] - effort) / motor - behind)
    return nominal + counts * (behind - nominal)
