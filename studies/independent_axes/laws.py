"""Laws that both axes share: friction, springs, drifts, plays, sensors."""

import math

from numba import njit

from studies.independent_axes.states import GEAR, PLAY, REST, SEEN, SHARES, WAY, X

RECORD = 8.0  # s: drifts are stated per so long a record


@njit(cache=True)
def drifted(amount, time, t):
    """A drift at time t: linear, or exponential with the same gain after a whole record."""
    if time == 0.0:
        return amount * t / RECORD
    return amount * (1.0 - math.exp(-t / time)) / (1.0 - math.exp(-RECORD / time))


@njit(cache=True)
def level(rig, t, x, v, way):
    """Dry friction while it slides at v in direction `way`; with v = 0 what breaks away at once."""
    force = rig.coulomb * (1.0 + rig.asymmetry * way)
    if rig.stribeck_speed > 0.0:
        force *= 1.0 + (rig.stick_ratio - 1.0) * math.exp(-abs(v) / rig.stribeck_speed)
    if rig.place_amount != 0.0:
        off = abs(x - rig.place) / rig.place_width
        force *= 1.0 + rig.place_amount * (0.5 + 0.5 * math.cos(math.pi * min(off, 1.0)))
    return force * (1.0 + drifted(rig.friction_drift, rig.friction_drift_time, t))


@njit(cache=True)
def dwelt(rig, y):
    """By what break-away has grown at rest."""
    return 1.0 + rig.dwell_gain * (1.0 - math.exp(-y[REST] / 0.5))


@njit(cache=True)
def pushes(rig, t, x, v):
    """Forces that both axes may have beside their drive."""
    total = rig.force - rig.viscous * v
    if rig.spring > 0.0:
        d = (x - rig.spring_at) / rig.spring_length
        total -= rig.spring * rig.spring_length * math.sinh(d)
    if rig.drag > 0.0:
        total -= rig.drag * v * abs(v)
    if rig.shake > 0.0:
        total += rig.shake * math.sin(2.0 * math.pi * rig.shake_frequency * t + rig.shake_phase)
    return total


@njit(cache=True)
def play(rig, u, y):
    """Of a command behind plays in parallel (Prandtl and Ishlinskii), mean half-width `hysteresis`."""
    if rig.hysteresis == 0.0:
        return u
    total = 0.0
    for k in range(len(SHARES)):
        width = rig.hysteresis * SHARES[k]
        y[PLAY + k] = min(max(y[PLAY + k], u - width), u + width)
        total += y[PLAY + k] / len(SHARES)
    return total


@njit(cache=True)
def reading(rig, t, x, y, before):
    """What the sensor says of a position x, without noise; `before` is the last command."""
    seen = x
    if rig.backlash > 0.0:
        seen = min(max(y[GEAR], x - rig.backlash), x + rig.backlash)
    if rig.sensor_time > 0.0:
        seen = y[SEEN]
    if rig.bend != 0.0:
        seen += rig.bend * math.sin(2.0 * math.pi * x / rig.bend_pitch)
    return seen + drifted(rig.sensor_drift, 0.0, t) + rig.crosstalk * before


@njit(cache=True)
def remember(rig, y, h):
    """What does not forget moves on."""
    y[GEAR] = min(max(y[GEAR], y[X] - rig.backlash), y[X] + rig.backlash)
    y[REST] = y[REST] + h if y[WAY] == 0.0 else 0.0
