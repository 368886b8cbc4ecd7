"""Smooth forms of laws whose slope is infinite or jumps; each width is a parameter whose error is stated."""

from __future__ import annotations

from typing import Any

import casadi as ca


def signed_root(q: Any, width: Any) -> Any:
    """sign(q) sqrt(abs(q)) with a finite slope 1/sqrt(width) at q = 0 (the idea of Modelica's regRoot).

    The relative error is (width/q)^2 / 4 for abs(q) >> width: at width = 2e-3, 0.01 % at q = 0.1.

    Parameters
    ----------
    q : Any
        the signal.
    width : Any
        of the smooth part, in the signal's unit.

    Returns
    -------
    Any
        the root, an odd function of q.
    """
    return q / ca.sqrt(ca.sqrt(q * q + width * width))


def soft_power(q: Any, exponent: Any, width: Any) -> Any:
    """sign(q) abs(q)^exponent with a finite slope at q = 0; q itself at exponent 1, whatever the width.

    The relative error is (exponent - 1)/2 (width/q)^2 for abs(q) >> width.

    Parameters
    ----------
    q : Any
        the signal.
    exponent : Any
        of the power.
    width : Any
        of the smooth part, in the signal's unit.

    Returns
    -------
    Any
        the power, an odd function of q.
    """
    return q * (q * q + width * width) ** ((exponent - 1) / 2)


def soft_floor(value: Any, floor: Any, width: Any) -> Any:
    """max(value, floor) with one continuous derivative: exact outside floor +- width, at most width/4 above inside.

    Parameters
    ----------
    value : Any
        the signal.
    floor : Any
        lower bound, in the signal's unit.
    width : Any
        of the transition, in the signal's unit.

    Returns
    -------
    Any
        the bounded signal.
    """
    inside = (value - floor + width) ** 2 / (4 * width) + floor
    return ca.if_else(value > floor + width, value, ca.if_else(value < floor - width, floor, inside))


def dead_zone(value: Any, half_width: Any) -> Any:
    """The part of a value beyond +- half_width; the value itself at a half width of zero.

    Not smoothed: its slopes are bounded, and a smoothed one would not be the identity at half width 0.

    Parameters
    ----------
    value : Any
        the signal.
    half_width : Any
        of the zone, in the signal's unit.

    Returns
    -------
    Any
        what exceeds the zone.
    """
    return ca.fmax(value - half_width, 0) + ca.fmin(value + half_width, 0)
