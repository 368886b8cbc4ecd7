"""A servo cylinder: its numbers and its equations; pressures follow from what the chambers hold."""

import math
from typing import NamedTuple

from numba import njit

from studies.independent_axes.laws import drifted, dwelt, level, play, pushes
from studies.independent_axes.states import SEEN, STOOD, WAY, A, B, C, D, E, F, P, X

ROOM, EXPONENT = 1e5, 1.4  # Pa, where air contents are stated, and of its compression
LAMINAR = 5e4  # Pa: drop below which orifices pass in proportion
VAPOUR = 1e3  # Pa: oil boils rather than bear less, and its vapour fills what oil and air leave


class Hydraulic(NamedTuple):
    """SI; pressures absolute. Defaults: the cylinder of data/servo_hydraulic.toml."""

    supply: float = 1e7
    tank: float = 2e5
    room: float = 1e5
    rated_flow: float = 20e-3 / 60.0
    rated_drop: float = 35e5
    lap: float = 0.0
    bulk: float = 1.2e9
    air: float = 5e-3
    density: float = 870.0
    bore: float = 40e-3
    rod: float = 28e-3
    stroke: float = 0.2
    dead_volume: float = 5e-5
    leak: float = 1e-12  # m3/(s Pa) past the piston
    mass: float = 150.0
    viscous: float = 1500.0
    coulomb: float = 300.0
    full: float = 1.0  # share

    stick_ratio: float = 1.0
    stribeck_speed: float = 0.0
    asymmetry: float = 0.0
    place_amount: float = 0.0
    place: float = 0.0
    place_width: float = 0.03
    friction_drift: float = 0.0
    friction_drift_time: float = 0.0
    seal: float = 0.0  # N/Pa: dry friction with the chambers' pressures above the room's
    dwell_gain: float = 0.0

    force: float = 0.0
    spring: float = 0.0
    spring_at: float = 0.0
    spring_length: float = 0.1
    drag: float = 0.0
    shake: float = 0.0
    shake_frequency: float = 3.0
    shake_phase: float = 0.0

    leak_cross: float = 0.0  # m3/(s Pa), laminar, beyond `leak`
    leak_a: float = 0.0
    score_cross: float = 0.0  # m2, orifices
    score_a: float = 0.0
    thinning: float = 0.0  # logarithm of the viscosity gained in a record
    thinning_time: float = 0.0
    relief: float = 0.0  # m2 from A to tank, fully open 5 bar above ...
    relief_pressure: float = 6e6
    creep: float = 0.0  # m3/Pa by which hoses widen in the long run
    pulsation: float = 0.0  # share of the supply pressure
    pulsation_frequency: float = 9.0

    valve_offset: float = 0.0
    valve_asymmetry: float = 0.0
    valve_frequency: float = 0.0  # rad/s; 0: at once
    valve_damping: float = 0.8
    limit: float = 1.0
    hysteresis: float = 0.0
    delay: float = 0.0
    flow_force: float = 0.0  # share of the opening lost at full pressure drop
    stiction: float = 0.0  # the spool jumps after the command has gone so far

    backlash: float = 0.0
    sensor_time: float = 0.0
    bend: float = 0.0
    bend_pitch: float = 0.2
    sensor_drift: float = 0.0
    crosstalk: float = 0.0


@njit(cache=True)
def target(rig, u, y):
    """Where the spool is sent, share of full travel."""
    if rig.stiction > 0.0:
        if abs(u - y[STOOD]) > rig.stiction:
            y[STOOD] = u
        u = y[STOOD]
    u = play(rig, u + rig.valve_offset, y)
    return min(max(u, -rig.limit), rig.limit)


@njit(cache=True)
def filled(rig, P_):
    """Volume of a unit of content at a pressure."""
    return (1.0 - rig.air) * math.exp(-(P_ - ROOM) / rig.bulk) + rig.air * (ROOM / P_) ** (1.0 / EXPONENT)


@njit(cache=True)
def pressure(rig, volume, content):
    """Pressure at which oil with bubbles of so much content fills a volume, Pa: Newton's method."""
    wanted = volume / content
    if wanted >= filled(rig, VAPOUR):
        return VAPOUR
    P_ = 5e6
    for _ in range(40):
        oil = (1.0 - rig.air) * math.exp(-(P_ - ROOM) / rig.bulk)
        bubbles = rig.air * (ROOM / P_) ** (1.0 / EXPONENT)
        slope = -oil / rig.bulk - bubbles / (EXPONENT * P_)
        step = (oil + bubbles - wanted) / slope
        P_ = max(P_ - step, 0.2 * P_)
        if abs(step) < 1e-7 * P_:
            break
    return P_


@njit(cache=True)
def content_at(rig, volume, P_):
    """Content of a volume at a pressure, m3."""
    return volume / filled(rig, P_)


@njit(cache=True)
def areas(rig):
    """Of the piston on either side, m2."""
    a = math.pi / 4.0 * rig.bore**2
    return a, a - math.pi / 4.0 * rig.rod**2


@njit(cache=True)
def volumes(rig, x):
    """Of the chambers, m3."""
    a, b = areas(rig)
    return a * (rig.stroke / 2.0 + x) + rig.dead_volume, b * (rig.stroke / 2.0 - x) + rig.dead_volume


@njit(cache=True)
def pressures(rig, s):
    """In the chambers, Pa."""
    V_a, V_b = volumes(rig, s[X])
    return pressure(rig, V_a + rig.creep * s[E], s[A]), pressure(rig, V_b + rig.creep * s[F], s[B])


@njit(cache=True)
def root(drop):
    """Signed root of a pressure drop, a line below LAMINAR."""
    if abs(drop) < LAMINAR:
        return drop / math.sqrt(LAMINAR)
    return math.copysign(math.sqrt(abs(drop)), drop)


@njit(cache=True)
def edge(rig, way, high, low):
    """Flow of one edge, m3/s, that a spool opens which has gone `way`."""
    opening = max(way - rig.lap, 0.0)
    if rig.flow_force > 0.0:
        opening *= max(1.0 - rig.flow_force * abs(high - low) / rig.supply, 0.1)
    return rig.rated_flow * opening * root(high - low) / math.sqrt(rig.rated_drop)


@njit(cache=True)
def flows(rig, t, u, P_a, P_b):
    """Into the chambers, m3/s."""
    u *= 1.0 + rig.valve_asymmetry * math.copysign(1.0, u)
    supply = rig.supply
    if rig.pulsation > 0.0:
        supply *= 1.0 + rig.pulsation * math.sin(2.0 * math.pi * rig.pulsation_frequency * t)
    into_a = edge(rig, u, supply, P_a) - edge(rig, -u, P_a, rig.tank)
    into_b = edge(rig, -u, supply, P_b) - edge(rig, u, P_b, rig.tank)
    thin = math.exp(-drifted(rig.thinning, rig.thinning_time, t))
    across = (rig.leak + rig.leak_cross) * thin * (P_a - P_b)
    per_root = math.sqrt(2.0 / rig.density)
    across += rig.score_cross * per_root * root(P_a - P_b)
    out = rig.leak_a * thin * (P_a - rig.tank) + rig.score_a * per_root * root(P_a - rig.tank)
    if rig.relief > 0.0:
        opens = min(max((P_a - rig.relief_pressure) / 5e5, 0.0), 1.0)
        out += opens * rig.relief * per_root * root(P_a - rig.tank)
    return into_a - across - out, into_b + across


@njit(cache=True)
def net(rig, t, s, P_a, P_b, v):
    """Force on the piston but for dry friction, N."""
    a, b = areas(rig)
    thick = math.exp(drifted(rig.thinning, rig.thinning_time, t)) - 1.0
    return a * P_a - b * P_b - (a - b) * rig.room + pushes(rig, t, s[X], v) - thick * rig.viscous * v


@njit(cache=True)
def dry_level(rig, t, s, P_a, P_b, v, way):
    """Dry friction, N."""
    return level(rig, t, s[X], v, way) + rig.seal * (P_a + P_b - 2.0 * rig.room)


@njit(cache=True)
def rates(rig, t, way, s, y, goal, dy):
    """d(s)/dt into `dy` while sliding in direction `way`, or held (0)."""
    v = s[P] / rig.mass if way != 0.0 else 0.0
    P_a, P_b = pressures(rig, s)
    u = s[C] if rig.valve_frequency > 0.0 else goal
    Q_a, Q_b = flows(rig, t, u, P_a, P_b)
    V_a, V_b = volumes(rig, s[X])
    dy[X] = v
    dy[P] = net(rig, t, s, P_a, P_b, v) - way * dry_level(rig, t, s, P_a, P_b, v, way) if way != 0.0 else 0.0
    most = filled(rig, VAPOUR)  # oil flows into vapour as oil
    dy[A] = Q_a / min((V_a + rig.creep * s[E]) / s[A], most)
    dy[B] = Q_b / min((V_b + rig.creep * s[F]) / s[B], most)
    w = rig.valve_frequency
    dy[C], dy[D] = s[D], w * w * (goal - s[C]) - 2.0 * rig.valve_damping * w * s[D]
    dy[E], dy[F] = (P_a - s[E]) / 0.3, (P_b - s[F]) / 0.3
    dy[SEEN] = (s[X] - s[SEEN]) / rig.sensor_time if rig.sensor_time > 0.0 else 0.0


@njit(cache=True)
def break_away(rig, t, s, y, goal):
    """What pushes a piston at rest, N, and what dry friction bears."""
    P_a, P_b = pressures(rig, s)
    total = net(rig, t, s, P_a, P_b, 0.0)
    way = 1.0 if total > 0.0 else -1.0
    return total, dry_level(rig, t, s, P_a, P_b, 0.0, way) * dwelt(rig, y)


@njit(cache=True)
def strike(rig, y):
    """The stroke's ends stop the piston."""
    if abs(y[X]) > rig.stroke / 2.0 and y[X] * y[P] > 0.0:
        y[X], y[P], y[WAY] = math.copysign(rig.stroke / 2.0, y[X]), 0.0, 0.0


@njit(cache=True)
def shown(rig, y, out):
    """What else is measured: the pressures, Pa."""
    out[0], out[1] = pressures(rig, y)
