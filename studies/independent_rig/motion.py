"""Forces on the piston: what slides, what sticks, what pushes besides."""

import math

from numba import njit

from studies.independent_rig.states import ELEMENT, PA, PB, REST, SHARES, V2, X2, V, X

RECORD = 8.0  # s: drifts are stated per so long a record
HARD = 0.075  # m: the way over which a spring hardens
DAMPING = 0.2  # of a contact that sticks, in sqrt(k m): a tenth of critical, 200 to 1500 N s/m on this axis


@njit(cache=True)
def drifted(amount, time, t):
    """A drift at time t: linear, or exponential with the same gain after a whole record."""
    if time == 0.0:
        return amount * t / RECORD
    return amount * (1.0 - math.exp(-t / time)) / (1.0 - math.exp(-RECORD / time))


@njit(cache=True)
def place_share(rig, x):
    """What dry friction gains at x, as a share."""
    off = x - rig.place
    if rig.place_form == 1.0:
        return 0.5 + 0.5 * math.cos(math.pi * off / rig.place_width) if abs(off) < rig.place_width else 0.0
    if rig.place_form == 2.0:
        return max(off / rig.place_width, 0.0)
    return (x / (rig.stroke / 2.0)) ** 2


@njit(cache=True)
def air_force(rig, s):
    """Force of the air on the piston and its rod, N."""
    area_a = math.pi / 4.0 * rig.bore**2
    area_rod = math.pi / 4.0 * rig.rod**2
    return area_a * s[PA] - (area_a - area_rod) * s[PB] - area_rod * rig.atmospheric_pressure


@njit(cache=True)
def level(rig, t, s, v, way):
    """Dry friction while it slides at v in direction `way`, N; with v = 0 what breaks away at once."""
    force, x = rig.coulomb, s[X]
    if rig.asymmetry != 0.0:
        force *= 1.0 + rig.asymmetry * way
    if rig.stribeck_speed > 0.0:
        pace = abs(v) / rig.stribeck_speed
        slow = math.exp(-pace) if rig.stribeck_form == 1.0 else 1.0 / (1.0 + pace * pace)
        force *= 1.0 + (rig.stick_ratio - 1.0) * slow
    elif v == 0.0:
        force *= rig.stick_ratio
    if rig.place_form != 0.0:
        force *= 1.0 + rig.place_amount * place_share(rig, x)
    if rig.friction_drift != 0.0:
        force *= 1.0 + drifted(rig.friction_drift, rig.friction_drift_time, t)
    if rig.side_load > 0.0:
        force += rig.side_load * abs(x) / (rig.stroke / 2.0) * abs(air_force(rig, s))
    return force


@njit(cache=True)
def drive_force(rig, t, s, v):
    """Everything on the piston at speed v except dry friction, N."""
    total = air_force(rig, s) - rig.viscous * v
    if rig.force != 0.0:
        total += rig.force
    if rig.spring > 0.0:
        d = s[X] - rig.spring_at
        total -= rig.spring * HARD * math.sinh(d / HARD)
    if rig.drag > 0.0:
        total -= math.copysign(rig.drag * abs(v) ** rig.drag_power, v)
    if rig.shake > 0.0:
        turn = 2.0 * math.pi * rig.shake_frequency * t + rig.shake_phase
        total += rig.shake * (math.sin(turn) + rig.shake_third * math.sin(3.0 * turn))
    if rig.cogging > 0.0:
        total += rig.cogging * math.sin(2.0 * math.pi * s[X] / rig.cogging_pitch)
    if rig.detent > 0.0:
        away = (s[X] - rig.detent_place) / rig.detent_width
        total -= rig.detent * away * math.exp(0.5 - 0.5 * away * away)
    if rig.load_share > 0.0:
        total += rig.load_stiffness * (s[X2] - s[X]) + rig.load_damping * (s[V2] - v)
    return total


@njit(cache=True)
def contact(rig, x, v, y):
    """Share of dry friction that an elastic contact holds: elements from where the step began (`y`)."""
    total, free = 0.0, 0.0
    for k in range(len(SHARES)):
        yield_at = rig.presliding * SHARES[k]
        z = y[ELEMENT + k] + (x - y[X])  # exactly the yield when nothing moves: no rounding may free it
        if abs(z) >= yield_at:
            total += math.copysign(1.0 / len(SHARES), z)
        else:
            total += z / yield_at / len(SHARES)
            free += 1.0 / len(SHARES)
    # Elements that stick are damped a little.
    return total + DAMPING * free * v * math.sqrt(rig.mass / (rig.coulomb * rig.presliding))


@njit(cache=True)
def break_away(rig, t, s, y):
    """Dry friction that a piston at rest can bear, N, in the direction in which it is pushed, and that push."""
    push = drive_force(rig, t, s, 0.0)
    way = 1.0 if push > 0.0 else -1.0
    force = level(rig, t, s, 0.0, way)
    if rig.dwell_gain > 0.0:
        force *= 1.0 + rig.dwell_gain * (1.0 - math.exp(-y[REST] / rig.dwell_time))
    return force, push


@njit(cache=True)
def acceleration(rig, t, way, s, y):
    """Of the piston, m/s2; `y` is the state in which the step began."""
    moving = rig.mass * (1.0 - rig.load_share)
    net = drive_force(rig, t, s, s[V])
    if rig.presliding > 0.0:
        v = s[V]
        share = contact(rig, s[X], v, y)
        return (net - level(rig, t, s, v, math.copysign(1.0, share)) * share) / moving
    return (net - way * level(rig, t, s, s[V], way)) / moving
