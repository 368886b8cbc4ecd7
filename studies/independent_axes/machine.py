"""The compiled loop of an axis. Which equations a rig has, numba picks by the fields of its record.

numba keeps what it compiled until this file changes: after changed laws, delete `__pycache__`.
"""

import math

import numpy as np
from numba import njit
from numba.extending import overload

from studies.independent_axes import hydraulic, rotary
from studies.independent_axes.laws import reading, remember
from studies.independent_axes.states import GOAL, SMOOTH, WAY, P, X


def rates(rig, t, way, s, y, goal, dy):
    """See the axes."""


def break_away(rig, t, s, y, goal):
    """See the axes."""


def strike(rig, y):
    """See the axes."""


def target(rig, u, y):
    """See the axes."""


def shown(rig, y, out):
    """See the axes."""


def _equations(rig):
    return rotary if "gear" in rig.fields else hydraulic


@overload(rates)
def _rates(rig, t, way, s, y, goal, dy):
    own = _equations(rig).rates
    return lambda rig, t, way, s, y, goal, dy: own(rig, t, way, s, y, goal, dy)


@overload(break_away)
def _break_away(rig, t, s, y, goal):
    own = _equations(rig).break_away
    return lambda rig, t, s, y, goal: own(rig, t, s, y, goal)


@overload(strike)
def _strike(rig, y):
    own = _equations(rig).strike
    return lambda rig, y: own(rig, y)


@overload(target)
def _target(rig, u, y):
    own = _equations(rig).target
    return lambda rig, u, y: own(rig, u, y)


@overload(shown)
def _shown(rig, y, out):
    own = _equations(rig).shown
    return lambda rig, y, out: own(rig, y, out)


@njit(cache=True)
def runge_kutta(rig, t, way, y, h, new, k):
    """One classical fourth-order step from `y` into `new`."""
    goal, g = y[GOAL], h / 2.0
    rates(rig, t, way, y, y, goal, k[0])
    for i in range(SMOOTH):
        new[i] = y[i] + g * k[0, i]
    rates(rig, t + g, way, new, y, goal, k[1])
    for i in range(SMOOTH):
        new[i] = y[i] + g * k[1, i]
    rates(rig, t + g, way, new, y, goal, k[2])
    for i in range(SMOOTH):
        new[i] = y[i] + h * k[2, i]
    rates(rig, t + h, way, new, y, goal, k[3])
    for i in range(SMOOTH):
        new[i] = y[i] + h / 6.0 * (k[0, i] + 2.0 * k[1, i] + 2.0 * k[2, i] + k[3, i])


@njit(cache=True)
def advance(rig, t, y, h, new, k):
    """One step with every stop and break-away in it."""
    left = h
    for _ in range(6):
        if y[WAY] == 0.0:
            push, bears = break_away(rig, t + h - left, y, y, y[GOAL])
            if abs(push) > bears:
                y[WAY] = math.copysign(1.0, push)
        way = y[WAY]
        runge_kutta(rig, t + h - left, way, y, left, new, k)
        if way == 0.0 or new[P] * way >= 0.0:
            y[:SMOOTH] = new[:SMOOTH]
            break
        # It comes to rest inside the step: go to that instant, where it sticks or turns.
        part = left * y[P] / (y[P] - new[P])
        runge_kutta(rig, t + h - left, way, y, part, new, k)
        y[:SMOOTH] = new[:SMOOTH]
        y[P], y[WAY] = 0.0, 0.0
        left -= part
        if part <= 1e-6 * h:  # it would turn at once: friction holds it for what is left of the step
            runge_kutta(rig, t + h - left, 0.0, y, left, new, k)
            y[:SMOOTH] = new[:SMOOTH]
            break
    strike(rig, y)
    remember(rig, y, h)


@njit(cache=True)
def closed_loop(rig, gains, reference, noise, clock, y, out, signals):
    """Sample, control, hold: `out` receives the states at every sample, `signals` command and readings."""
    kp, ki, kd, filter_time, limit, quantum, per_volt = gains
    dt, steps, late = clock
    h, new, k = dt / steps, np.empty(SMOOTH), np.zeros((4, SMOOTH))
    integral, slope, before, u = 0.0, 0.0, 0.0, 0.0
    told = np.zeros(len(reference))
    for n in range(len(reference)):
        seen = reading(rig, n * dt, y[X], y, u * per_volt) + noise[n]
        if n == 0:
            before = seen
        slope += dt / (filter_time + dt) * ((seen - before) / dt - slope)
        before = seen
        error = reference[n] - seen
        wish = kp * error + ki * integral - kd * slope
        u = min(max(wish, -limit), limit)
        if u == wish or error * wish < 0.0:  # no wind-up at the limits
            integral += error * dt
        u = min(max(quantum * round(u / quantum), -limit), limit)
        out[n] = y
        signals[n, 0], signals[n, 1] = u, seen
        shown(rig, y, signals[n, 2:])
        told[n] = u * per_volt
        last = -1
        for j in range(steps):
            at = (n * steps + j - late) // steps
            if at != last:
                y[GOAL] = target(rig, told[at] if at >= 0 else 0.0, y)
                last = at
            advance(rig, n * dt + j * h, y, h, new, k)
