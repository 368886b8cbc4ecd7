"""What the rig is made of: its numbers, its controller, its sensors, and what a run of it leaves."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Rig(NamedTuple):
    """SI; pressures absolute. Defaults: table 1 of the paper, Delta excepted, and nothing beyond it."""

    supply_pressure: float = 7e5
    exhaust_pressure: float = 1e5
    atmospheric_pressure: float = 1e5
    temperature: float = 293.0
    heat_ratio: float = 1.4
    gas_constant: float = 287.0
    port_width: float = 6.2e-3
    spool_travel: float = 4e-3
    discharge: float = 0.8
    bore: float = 42e-3
    rod: float = 16e-3
    stroke: float = 0.26
    residual_length: float = 10e-3
    mass: float = 1.9
    viscous: float = 78.0
    coulomb: float = 83.0
    stick_ratio: float = 1.0  # force that breaks away over force that slides
    restitution: float = 0.2  # of the stroke's ends

    # Dry friction. Its level in motion is coulomb x (what follows).
    stribeck_speed: float = 0.0  # m/s over which stick_ratio decays; 0: at once
    stribeck_form: float = 0.0  # 0: Lorentz's curve, 1: exp(-|v| / speed)
    asymmetry: float = 0.0  # share: more when it extends, less when it retracts
    place_form: float = 0.0  # 0: none, 1: raised cosine, 2: rising beyond `place`, 3: towards both ends
    place_amount: float = 0.0  # share at the top
    place: float = 0.0  # m
    place_width: float = 0.04  # m
    friction_drift: float = 0.0  # share gained in 8 s
    friction_drift_time: float = 0.0  # s: exponential; 0: linear
    presliding: float = 0.0  # m: mean yield of five elastic-plastic elements (Iwan); 0: rigid
    dwell_gain: float = 0.0  # share that break-away gains at rest in the long run
    dwell_time: float = 0.5  # s
    side_load: float = 0.0  # share of the air's force that presses on the bearing at the stroke's ends

    # Other forces.
    force: float = 0.0  # N
    spring: float = 0.0  # N/m, and it hardens: k h sinh(d / h) with motion.HARD
    spring_at: float = 0.0  # m
    drag: float = 0.0  # N at 1 m/s
    drag_power: float = 2.0
    shake: float = 0.0  # N
    shake_frequency: float = 3.0  # Hz
    shake_phase: float = 0.0
    shake_third: float = 0.0  # share of the third harmonic
    cogging: float = 0.0  # N, sine over position
    cogging_pitch: float = 0.02  # m
    detent: float = 0.0  # N, of a latch that pulls into its place from either side
    detent_place: float = 0.0  # m
    detent_width: float = 0.01  # m, where it pulls most
    load_share: float = 0.0  # of the mass, behind a spring
    load_stiffness: float = 0.0  # N/m
    load_damping: float = 0.0  # N s/m

    # Air.
    leak_cross: float = 0.0  # m2
    leak_a: float = 0.0  # m2 to the room
    leak_b: float = 0.0
    leak_laminar: float = 0.0  # 1: flow goes with the difference of squared pressures
    relief: float = 0.0  # m2 from A to the room, fully open 1 bar above ...
    relief_pressure: float = 4e5
    wall_heat: float = 0.0  # W/(m2 K); above 0 temperatures are states and the energy balance is full
    critical_ratio: float = 0.0  # ISO 6358; 0: de Saint Venant and Wantzel
    flow_exponent: float = 0.5
    reservoir: float = 0.0  # m3 between regulator and valve
    line_area: float = 1e-5  # m2 of the regulator
    silencer: float = 0.0  # m2 between exhaust ports and room
    manifold: float = 2e-5  # m3 before the silencer
    cushion_length: float = 0.0  # m
    cushion_area: float = 1e-6  # m2 of the needle
    cushion_side: float = 0.0  # +1, -1, or 0 for both ends
    creep: float = 0.0  # m3/Pa by which tubes widen in the long run
    creep_time: float = 0.5  # s
    pulsation: float = 0.0  # share of the supply pressure
    pulsation_frequency: float = 7.0  # Hz

    # Valve. Lengths as shares of the travel.
    overlap_supply_a: float = 0.0  # negative: underlap
    overlap_exhaust_a: float = 0.0
    overlap_supply_b: float = 0.0
    overlap_exhaust_b: float = 0.0
    edge_round: float = 0.0
    clearance: float = 0.0
    valve_offset: float = 0.0
    valve_order: float = 0.0
    valve_frequency: float = 600.0  # rad/s
    valve_damping: float = 0.8
    valve_rate: float = 1e9  # 1/s
    delay: float = 0.0  # s
    valve_hysteresis: float = 0.0  # mean half-width of four plays (Prandtl and Ishlinskii)
    valve_stiction: float = 0.0  # the spool jumps after the command has gone so far
    limit_up: float = 1.0
    limit_down: float = 1.0
    flow_force: float = 0.0  # share of the opening lost at full pressure drop

    # Position sensor.
    backlash: float = 0.0  # m, half-width
    sensor_order: float = 0.0
    sensor_time: float = 1e-3  # s
    bend: float = 0.0  # m
    bend_pitch: float = 0.26  # m
    bend_phase: float = 0.0
    sensor_drift: float = 0.0  # m in 8 s
    sensor_drift_time: float = 0.0  # s: exponential; 0: linear
    crosstalk: float = 0.0  # m per unit of command
    bounce: float = 0.0  # m: a wiper that lifts off its track above ...
    bounce_speed: float = 0.2  # m/s


FIELDS = np.dtype([(name, "f8") for name in Rig._fields])


def packed(rig: Rig) -> np.void:
    """The rig as compiled functions take it: one record, so that none of them is compiled anew for it."""
    return np.array([tuple(rig)], dtype=FIELDS)[0]  # type: ignore[no-any-return]


@dataclass(frozen=True)
class Controller:
    """A sampled PID position controller with limits and a 12-bit output: V, m, s."""

    kp: float = 30.0
    ki: float = 20.0
    kd: float = 0.25
    filter_time: float = 4e-3
    limit: float = 5.0
    quantum: float = 10.0 / 4096


@dataclass(frozen=True)
class Sensors:
    """What the recording adds.

    Attributes:
        position_noise: sd, m.
        pressure_noise: sd, Pa.
        colour: AR(1) coefficient of both.
        quantum: step of the position's converter, m; 0 for none.
        skew: s by which the command changes after the position was sampled.
        dropouts: share of the position's samples that are lost, in short bursts.
        clock_drift: share by which the position's samples come ever later than the table says.
    """

    position_noise: float = 0.03e-3
    pressure_noise: float = 500.0
    colour: float = 0.0
    quantum: float = 0.0
    skew: float = 0.0
    dropouts: float = 0.0
    clock_drift: float = 0.0


@dataclass(frozen=True)
class Run:
    """True signals at the samples, SI: command in volts, `stuck` where dry friction holds the piston.

    `clean` is what the position sensor says without noise, `measured` with it; `states` is (n, states.COUNT).
    """

    t: Array
    command: Array
    reference: Array
    position: Array
    velocity: Array
    pressure_a: Array
    pressure_b: Array
    stuck: NDArray[np.bool_]
    measured: Array
    clean: Array
    states: Array


def balanced(rig: Rig) -> tuple[float, float, float, float]:
    """Rest at mid-stroke with no force on the piston, chamber B at 60 % of the way to supply."""
    area_a, area_rod = math.pi / 4 * rig.bore**2, math.pi / 4 * rig.rod**2
    P_b = rig.exhaust_pressure + 0.6 * (rig.supply_pressure - rig.exhaust_pressure)
    P_a = ((area_a - area_rod) * P_b + area_rod * rig.atmospheric_pressure) / area_a
    return 0.0, 0.0, P_a, P_b
