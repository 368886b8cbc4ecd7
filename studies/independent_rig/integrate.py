"""One step of the whole rig: classical Runge-Kutta between events, and the events of dry friction."""

import math

from numba import njit

from studies.independent_rig.air import air_rates
from studies.independent_rig.motion import acceleration, break_away
from studies.independent_rig.sensor import filter_rates, geared
from studies.independent_rig.states import ELEMENT, GEAR, GOAL, REST, SHARES, V2, WAY, X2, V, X
from studies.independent_rig.valve import spool, spool_rates


@njit(cache=True)
def rates(rig, t, way, s, y, dy):
    """d(s)/dt into `dy` while sliding in direction `way` (+1 or -1), or held (0); `y` began the step."""
    air_rates(rig, t, spool(rig, y[GOAL], s), s, dy)
    if way == 0.0:
        dy[X], dy[V] = 0.0, 0.0
    else:
        dy[X], dy[V] = s[V], acceleration(rig, t, way, s, y)
    spool_rates(rig, y[GOAL], s, dy)
    filter_rates(rig, s, y, dy)
    if rig.load_share > 0.0:
        force = rig.load_stiffness * (s[X2] - s[X]) + rig.load_damping * (s[V2] - s[V])
        dy[X2], dy[V2] = s[V2], -force / (rig.mass * rig.load_share)


@njit(cache=True)
def runge_kutta(rig, t, way, y, h, work):
    """One classical fourth-order step from `y`; `work` is rows to work in and the number of states in use."""
    rows, n = work
    k1, k2, k3, k4, s, new = rows[0], rows[1], rows[2], rows[3], rows[4], rows[5]
    g = h / 2.0
    rates(rig, t, way, y, y, k1)
    for i in range(n):
        s[i] = y[i] + g * k1[i]
    rates(rig, t + g, way, s, y, k2)
    for i in range(n):
        s[i] = y[i] + g * k2[i]
    rates(rig, t + g, way, s, y, k3)
    for i in range(n):
        s[i] = y[i] + h * k3[i]
    rates(rig, t + h, way, s, y, k4)
    for i in range(n):
        new[i] = y[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])
    return new


@njit(cache=True)
def way_from_rest(rig, t, s, y):
    """Direction in which a piston at rest starts to slide, 0 while dry friction or an end holds it."""
    bears, push = break_away(rig, t, s, y)
    if abs(push) - bears <= 0.0:
        return 0.0
    way = 1.0 if push > 0.0 else -1.0
    return 0.0 if way * s[X] >= rig.stroke / 2.0 else way


@njit(cache=True)
def excess(rig, t, s, y):
    """Force on a piston at rest beyond what dry friction holds, N."""
    bears, push = break_away(rig, t, s, y)
    return abs(push) - bears


@njit(cache=True)
def accept(y, new, n):
    """The step's smooth states become the rig's."""
    for i in range(n):
        y[i] = new[i]


@njit(cache=True)
def advance(rig, t, y, h, work):
    """One step of length h with every stop, break-away and impact in it; `y` moves on in place."""
    n, left, x_before = work[1], h, y[X]
    gear = geared(rig, y[X], y)
    if rig.presliding > 0.0:
        slide_elastic(rig, t, y, h, work)
        left = 0.0
    for _ in range(8):
        if left == 0.0:
            break
        if y[WAY] == 0.0:
            y[WAY] = way_from_rest(rig, t, y, y)
        way = y[WAY]
        new = runge_kutta(rig, t + h - left, way, y, left, work)
        if way == 0.0:
            start = way_from_rest(rig, t + h, new, y)
            if start == 0.0:
                accept(y, new, n)
                break
            # Dry friction gives way inside the step: go to that instant.
            before, after = excess(rig, t + h - left, y, y), excess(rig, t + h, new, y)
            part = left * min(max(before / (before - after), 0.0), 1.0)
            accept(y, runge_kutta(rig, t + h - left, 0.0, y, part, work), n)
            left -= part
            y[WAY] = start  # known from beyond the instant: at it, rounding may still say that it holds
        elif new[V] * way < 0.0:
            # The piston comes to rest inside the step: go to that instant, where it sticks or turns.
            part = left * y[V] / (y[V] - new[V])
            accept(y, runge_kutta(rig, t + h - left, way, y, part, work), n)
            y[V], y[WAY] = 0.0, 0.0
            left -= part
            if part <= 1e-6 * h:  # it would turn at once: friction holds it for what is left of the step
                accept(y, runge_kutta(rig, t + h - left, 0.0, y, left, work), n)
                break
        else:
            accept(y, new, n)
            break
    strike(rig, y)
    remember(rig, y, x_before, gear, h)


@njit(cache=True)
def slide_elastic(rig, t, y, h, work):
    """A step of a piston whose contact is elastic: it never quite rests."""
    accept(y, runge_kutta(rig, t, 1.0, y, h, work), work[1])
    y[WAY] = math.copysign(1.0, y[V])


@njit(cache=True)
def strike(rig, y):
    """The stroke's ends return a fast piston a little and stop a slow one."""
    if abs(y[X]) > rig.stroke / 2.0 and y[X] * y[V] > 0.0:
        back = -rig.restitution * y[V] if abs(y[V]) > 1e-2 else 0.0
        y[X], y[V] = math.copysign(rig.stroke / 2.0, y[X]), back
        y[WAY] = 0.0 if back == 0.0 else math.copysign(1.0, back)


@njit(cache=True)
def remember(rig, y, x_before, gear, h):
    """What does not forget moves on: elements of the contact, the sensor's gear, the time at rest."""
    if rig.presliding > 0.0:
        for k in range(len(SHARES)):
            most = rig.presliding * SHARES[k]
            y[ELEMENT + k] = min(max(y[ELEMENT + k] + y[X] - x_before, -most), most)
    y[GEAR] = min(max(gear, y[X] - rig.backlash), y[X] + rig.backlash)
    y[REST] = y[REST] + h if y[WAY] == 0.0 else 0.0
