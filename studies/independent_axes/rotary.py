"""A geared motor on a voltage amplifier that lifts an arm: its numbers and its equations, all at the output."""

import math
from typing import NamedTuple

from numba import njit

from studies.independent_axes.laws import dwelt, level, play, pushes
from studies.independent_axes.states import SEEN, WAY, A, B, C, P, X

GRAVITY = 9.80665
COPPER = 60.0  # W s: heat that doubles nothing yet but warms the winding by the stated share


class Rotary(NamedTuple):
    """SI; forces are torques at the output, lengths angles. Defaults: the arm of data/rotary_axis.toml."""

    gear: float = 20.0
    armature: float = 2e-5
    inertia: float = 4e-3
    mass: float = 0.5
    arm: float = 0.15
    torque_constant: float = 0.03
    resistance: float = 1.5
    viscous: float = 0.05
    coulomb: float = 0.12
    full: float = 12.0  # V

    stick_ratio: float = 1.0
    stribeck_speed: float = 0.0
    asymmetry: float = 0.0
    place_amount: float = 0.0
    place: float = 0.0
    place_width: float = 0.3
    friction_drift: float = 0.0
    friction_drift_time: float = 0.0
    load_friction: float = 0.0  # share of the motor's torque
    dwell_gain: float = 0.0

    force: float = 0.0
    spring: float = 0.0
    spring_at: float = 0.0
    spring_length: float = 1.5
    drag: float = 0.0
    shake: float = 0.0
    shake_frequency: float = 3.0
    shake_phase: float = 0.0
    cogging: float = 0.0
    cogging_turn: float = 12.0  # per turn of the motor
    cogging_phase: float = 0.0
    compliance: float = 0.0  # rad/(N m); with `play` the teeth's
    shaft_damping: float = 0.0  # N m s/rad
    play: float = 0.0

    delay: float = 0.0
    dead: float = 0.0  # V
    offset: float = 0.0
    limit: float = 1e9
    hysteresis: float = 0.0

    backlash: float = 0.0
    sensor_time: float = 0.0
    bend: float = 0.0
    bend_pitch: float = 2.0
    sensor_drift: float = 0.0
    crosstalk: float = 0.0

    warming: float = 0.0  # share by which the winding's resistance has grown after COPPER joules
    ripple: float = 0.0  # share of the torque, over the motor's turn: of the current, not of the magnets
    ripple_turn: float = 6.0
    sag: float = 0.0  # share of the voltage lost at 8 A

    @property
    def elastic(self) -> bool:
        """Whether the transmission gives."""
        return self.compliance > 0.0


@njit(cache=True)
def target(rig, u, y):
    """Voltage that the motor gets from a command, V."""
    u = play(rig, u + rig.offset, y)
    u = math.copysign(max(abs(u) - rig.dead, 0.0), u)
    return min(max(u, -rig.limit), rig.limit)


@njit(cache=True)
def motor(rig, volts, angle, speed, heat):
    """Torque of the motor at the output and current, A, at the output's angle and speed."""
    k = rig.gear * rig.torque_constant
    resistance = rig.resistance * (1.0 + rig.warming * heat / COPPER)
    current = (volts - k * speed) / resistance
    current -= rig.sag * volts * abs(current) / 8.0 / resistance
    torque = k * current * (1.0 + rig.ripple * math.sin(rig.ripple_turn * rig.gear * angle))
    if rig.cogging > 0.0:
        torque += rig.cogging * math.sin(rig.cogging_turn * rig.gear * angle + rig.cogging_phase)
    return torque, current


@njit(cache=True)
def shaft(rig, s, speed):
    """Torque of a shaft that gives, on the load."""
    twist, rate = s[A], s[B] / (rig.gear**2 * rig.armature) - speed
    beyond = math.copysign(max(abs(twist) - rig.play, 0.0), twist)
    touches = 1.0 if abs(twist) >= rig.play else 0.0
    return beyond / rig.compliance + touches * rig.shaft_damping * rate


@njit(cache=True)
def moving(rig):
    """Inertia of what moves with the load."""
    load = rig.inertia + rig.mass * rig.arm**2
    return load if rig.compliance > 0.0 else load + rig.gear**2 * rig.armature


@njit(cache=True)
def net(rig, t, s, volts, speed):
    """Torque on what moves with the load but for dry friction, and what drives it."""
    if rig.compliance > 0.0:
        drive = shaft(rig, s, speed)
    else:
        drive, _ = motor(rig, volts, s[X], speed, s[C])
    weight = rig.mass * GRAVITY * rig.arm * math.sin(s[X])
    return drive - weight + pushes(rig, t, s[X], speed), drive


@njit(cache=True)
def rates(rig, t, way, s, y, goal, dy):
    """d(s)/dt into `dy` while sliding in direction `way`, or held (0)."""
    speed = s[P] / moving(rig) if way != 0.0 else 0.0
    total, drive = net(rig, t, s, goal, speed)
    dy[X] = speed
    dry = level(rig, t, s[X], speed, way) + rig.load_friction * abs(drive)
    dy[P] = total - way * dry if way != 0.0 else 0.0
    if rig.compliance > 0.0:
        own = s[B] / (rig.gear**2 * rig.armature)
        torque, current = motor(rig, goal, s[X] + s[A], own, s[C])
        dy[A], dy[B] = own - speed, torque - drive
    else:
        _, current = motor(rig, goal, s[X], speed, s[C])
        dy[A], dy[B] = 0.0, 0.0
    dy[C] = rig.resistance * current**2
    dy[SEEN] = (s[X] - s[SEEN]) / rig.sensor_time if rig.sensor_time > 0.0 else 0.0


@njit(cache=True)
def break_away(rig, t, s, y, goal):
    """What pushes a load at rest, and what dry friction bears."""
    total, drive = net(rig, t, s, goal, 0.0)
    way = 1.0 if total > 0.0 else -1.0
    return total, (level(rig, t, s[X], 0.0, way) + rig.load_friction * abs(drive)) * dwelt(rig, y)


@njit(cache=True)
def strike(rig, y):
    """An arm has no stops."""


@njit(cache=True)
def shown(rig, y, out):
    """What else is measured: the current, A."""
    out[0], out[1] = motor(rig, y[12], y[X], y[P] / moving(rig) if y[WAY] != 0.0 else 0.0, y[C])
