"""A rotary servo axis: motor, gear and arm, with the drive's own loops where they are in the recorded path.

Reflected to the output (Spong, Hutchinson and Vidyasagar, Robot Modeling and Control, 2006, section 6.1), N the gear
ratio, with a rigid transmission and Armstrong-Hélouvry's friction (Control of Machines with Friction, 1991):

    (N^2 J_m + J_l + m l^2) w' = N tau - F_v w - F_c(w) - m g l sin(q + q_0)
    tau = K_t i,   i = (u - K_t N w) / R

The winding's inductance is left out: its time constant is far below that of the motion.
"""

from __future__ import annotations

import math
from typing import Any, Literal

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.rigs.end_stops import SAMPLING_SKEW
from optid.rigs.friction import dry_friction

SPONG = "Spong, Hutchinson and Vidyasagar, 2006, eqs. 6.4 to 6.16"
ELLIS = "Ellis, Control System Design Guide, 4th ed. 2012, chapter 17: cascaded P-PI"
POSITIVE, ANY = (1e-12, math.inf), (-math.inf, math.inf)
TRAVEL, EFFORT = 1.0, 1.0  # rad, N m: usual sizes of a bench axis
GRAVITY = 9.80665  # m/s2

GEAR_RATIO = Parameter(
    "gear_ratio", "1", 10.0, "turns of the motor per turn of the arm, N", SPONG, 1.0, POSITIVE
)
ARMATURE = Parameter(
    "armature", "kg m**2", 1e-4, "inertia J_m of the rotor, about the motor's shaft", SPONG, bounds=POSITIVE
)
LOAD_INERTIA = Parameter(
    "load_inertia", "kg m**2", 1e-2, "inertia J_l about the output", SPONG, 0.0, (0.0, 1e6)
)
PAYLOAD_MASS = Parameter(
    "payload_mass",
    "kg",
    0.5,
    "mass m at the end of the arm, which gravity turns down",
    SPONG,
    0.0,
    (0.0, 1e5),
)
ARM_LENGTH = Parameter(
    "arm_length", "m", 0.2, "from the output's axis to that mass, l", SPONG, 0.0, (0.0, 1e2)
)
ZERO_OFFSET = Parameter(
    "zero_offset",
    "rad",
    0.1,
    "angle q_0 of the arm from hanging down where the encoder shows 0",
    "encoders count from anywhere",
    0.0,
    (-7.0, 7.0),
)
LOAD_TORQUE = Parameter("load_torque", "N m", 0.1, "constant torque on the output", SPONG, 0.0, ANY)
TORQUE_CONSTANT = Parameter(
    "torque_constant", "N m/A", 0.1, "K_t, also the back-emf constant in V s/rad", SPONG, bounds=POSITIVE
)
RESISTANCE = Parameter("resistance", "V/A", 2.0, "resistance R of the winding", SPONG, bounds=POSITIVE)
VISCOUS_FRICTION = Parameter(
    "viscous_friction", "N m s/rad", 2e-2, "F_v, at the output", SPONG, bounds=(-1e3, 1e4)
)
POSITION_GAIN = Parameter(
    "position_gain", "1/s", 20.0, "speed that the drive demands per error of angle", ELLIS, bounds=(0.0, 1e4)
)
UNITS = {"torque": "N m", "current": "A", "voltage": "V"}  # units of the demand
SIZES = {"N m": 0.1, "A": 2.0, "V": 5.0, "rad/s": 5.0, "rad": TRAVEL}  # usual sizes of a command
# As in optid/rigs/friction.py.
STICK_BIAS = {
    "load_inertia": 8e-4,
    "payload_mass": 1e-4,
    "viscous_friction": 4e-4,
    "coulomb_friction": 1.5e-4,
}


def rotary_axis(
    s: Sheet,
    *,
    drive: Literal["torque", "current", "voltage"] = "torque",
    loop: Literal["none", "velocity", "position"] = "none",
    encoder: Literal["load", "motor"] = "load",
    friction: Literal["bristle", "smooth"] = "bristle",
) -> None:
    """Command -> torque of the motor -> speed -> angle of the arm.

    Args:
        drive: input of the motor: "torque" at its shaft, "current", or "voltage" with its back-emf.
        loop: loop that the drive closes; the command is the motor's torque, current or voltage ("none"), a
            speed ("velocity", rad/s) or an angle ("position", rad).
        encoder: on the "load" or on the "motor"; they differ where the transmission is elastic.
        friction: "bristle" (Dahl's law: sticks) or "smooth" (tanh over `friction_width`: creeps).
    """
    s.axis("rad", TRAVEL, "N m", EFFORT)
    s.suspect("drive.command")
    s.suspect("force.external")
    s.suspect("sensor.position")
    N, J_m = s.param(GEAR_RATIO), s.param(ARMATURE)
    m, l = s.param(PAYLOAD_MASS), s.param(ARM_LENGTH)  # noqa: E741 - the book's name
    J_load = s.param(LOAD_INERTIA) + m * l**2
    J = N**2 * J_m + J_load
    q, w = s.state("position", "rad", 0.1, spread=1.0), s.state("velocity", "rad/s", 1.0, spread=2.0)
    masses = {"motor": N**2 * J_m, "load": J_load}
    shaft = s.site("force.shaft_angle", q, unit="rad", size=0.0, **masses)
    turning = s.site("force.shaft_speed", w, unit="rad/s", size=0.0, **masses)

    demand = _demand(s, shaft, turning, drive, loop)
    torque = N * _torque(s, demand, N * turning, drive)
    torque = s.site("drive.effort", torque, unit="N m", size=EFFORT, x=shaft, v=turning, turn=2 * math.pi / N)

    viscous = s.site("force.viscous", s.param(VISCOUS_FRICTION) * w, unit="N m", size=0.1 * EFFORT, v=w, x=q)
    L = 2 * TRAVEL
    dry = dry_friction(s, w, friction, x=q, L=L, drive=torque)
    if friction == "bristle":
        s.biased(**STICK_BIAS)
    drag = s.site("force.friction", viscous + dry, unit="N m", size=0.1 * EFFORT, x=q, v=w)
    weight = m * GRAVITY * l * ca.sin(q + s.param(ZERO_OFFSET))
    external = s.param(LOAD_TORQUE) - weight
    external = s.site("force.external", external, unit="N m", size=0.1 * EFFORT, x=q, v=w, L=L)
    net = torque - drag + external
    a = s.site("force.acceleration", net / J, unit="rad/s**2", size=10.0, net=net, mass=J, x=q, v=w)
    s.rate(q, w)
    s.rate(
        w,
        s.site(
            "force.transmission",
            a,
            unit="rad/s**2",
            size=0.0,
            driven=torque,
            loaded=external - drag,
            **masses,
        ),
    )

    seen = shaft if encoder == "motor" else q
    seen = seen - s.param(SAMPLING_SKEW) * (turning if encoder == "motor" else w)
    s.output("position", "rad", s.site("sensor.position", seen, unit="rad", size=TRAVEL, x=q, v=w, a=a, L=L))


def _demand(s: Sheet, shaft: Any, turning: Any, drive: str, loop: str) -> Any:
    """Output of the drive to the motor, in the unit of its kind."""
    unit = {"none": UNITS[drive], "velocity": "rad/s", "position": "rad"}[loop]
    idle = None if loop == "position" else 0.0
    command = s.site("drive.command", s.input("command", unit, idle=idle), unit=unit, size=SIZES[unit])
    if loop == "none":
        return command
    wanted = s.param(POSITION_GAIN) * (command - shaft) if loop == "position" else command
    of = UNITS[drive]
    gain = s.param(
        Parameter("speed_gain", f"{of} s/rad", 1.0, "demand per error of speed", ELLIS, bounds=POSITIVE)
    )
    rate = s.param(
        Parameter(
            "speed_integral_gain", f"{of}/rad", 10.0, "demand per integral of that", ELLIS, 0.0, (0.0, 1e9)
        )
    )
    most = s.param(Parameter("drive_limit", of, 10.0, "largest demand", ELLIS, 1e9, POSITIVE))
    kept = s.state("drive_integral", of, 1.0, spread=1.0)
    error = wanted - turning
    asked = gain * error + kept
    given = ca.fmin(ca.fmax(asked, -most), most)
    # Integration stops at the limit by Åström and Hägglund's back-calculation.
    s.rate(kept, rate * (error + (given - asked) / gain))
    return given


def _torque(s: Sheet, demand: Any, speed: Any, drive: str) -> Any:
    """Torque of the motor, N m, at its speed, rad/s."""
    if drive == "torque":
        return demand
    K = s.param(TORQUE_CONSTANT)
    current = demand if drive == "current" else (demand - K * speed) / s.param(RESISTANCE)
    return K * current
