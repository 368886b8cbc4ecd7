"""An electro-mechanical positioning axis: a motor and a ball screw move a carriage against friction.

Equations and names follow the benchmark "Data Set and Reference Models of EMPS" (Janot, Gautier and Brunot,
workshop on nonlinear system identification benchmarks, 2019):

    M q'' = gtau u - F_v q' - F_c sign(q') - offset

The jump of the sign is replaced by one of two stated laws (`optid.rigs.friction`).
"""

from __future__ import annotations

import math
from typing import Any, Literal

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.rigs.friction import COULOMB_FRICTION, dry_friction, sliding

EMPS = "Janot, Gautier and Brunot, EMPS benchmark, 2019"
POSITIVE = (1e-12, math.inf)
# Origin, m, for effects that depend on position: the benchmark's recordings span 0 to 0.246 m.
MIDDLE, TRAVEL = 0.125, 0.25

MASS = Parameter("mass", "kg", 100.0, "moving mass M, with the motor's inertia", EMPS, bounds=POSITIVE)
DRIVE_GAIN = Parameter(
    "drive_gain",
    "N/V",
    35.0,
    "force per volt of command, gtau",
    "EMPS benchmark: 35.1507 N/V, measured apart",
    bounds=(-1e6, 1e6),
)
VISCOUS_FRICTION = Parameter(
    "viscous_friction", "N s/m", 200.0, "viscous friction F_v", EMPS, bounds=(-1e5, 1e6)
)
FORCE_OFFSET = Parameter(
    "force_offset",
    "N",
    5.0,
    "constant force against positive motion: offset of the drive, tilt",
    EMPS,
    0.0,
    (-1e6, 1e6),
)
VISCOUS_FRICTION_NEGATIVE = Parameter(
    "viscous_friction_negative",
    "N s/m",
    200.0,
    "viscous friction of negative motion; viscous_friction then counts for positive motion alone",
    EMPS,
    bounds=(-1e5, 1e6),
)
COULOMB_FRICTION_NEGATIVE = Parameter(
    "coulomb_friction_negative",
    "N",
    80.0,
    "dry friction of negative motion; coulomb_friction then counts for positive motion alone",
    EMPS,
    bounds=(0.0, 1e6),
)


def emps(
    s: Sheet,
    *,
    friction: Literal["bristle", "smooth"] = "bristle",
    direction: Literal["symmetric", "separate"] = "symmetric",
) -> None:
    """Command (V) -> force -> speed -> position of a carriage.

    Args:
        friction: "bristle" (Dahl's law: sticks, slides after `presliding_length`) or "smooth" (tanh over
            `friction_width`: creeps instead of sticking).
        direction: "symmetric", or "separate" friction for each direction of motion. In motion, separate dry friction
            and `force_offset` are the same parameter twice: fix one of them.
    """
    q, v = s.state("position", "m", 0.01, spread=0.5), s.state("velocity", "m/s", 0.1, spread=0.5)
    u = s.site("drive.command", s.input("command", "V", idle=0.0), unit="V", size=3.0)
    drag = viscous_and_dry_friction(s, q, v, friction, direction)
    drag = s.site("force.friction", drag, unit="N", v=v)
    external = s.site("force.external", -s.param(FORCE_OFFSET), unit="N", x=q - MIDDLE, v=v, L=TRAVEL)
    s.rate(q, v)
    s.rate(v, (s.param(DRIVE_GAIN) * u - drag + external) / s.param(MASS))
    s.output("position", "m", s.site("sensor.position", q, unit="m", x=q - MIDDLE, v=v, L=TRAVEL))


def viscous_and_dry_friction(s: Sheet, q: Any, v: Any, friction: str, direction: str) -> Any:
    """Friction force against positive motion, N, at speed v (m/s). See `emps` for the choices."""
    if direction == "symmetric":
        viscous = s.site("force.viscous", s.param(VISCOUS_FRICTION) * v, unit="N", v=v)
        return viscous + dry_friction(s, v, friction, x=q - MIDDLE, L=TRAVEL)
    share = sliding(s, v, friction)
    forwards = s.param(VISCOUS_FRICTION) * ca.fmax(v, 0) + s.param(COULOMB_FRICTION) * ca.fmax(share, 0)
    backwards = s.param(VISCOUS_FRICTION_NEGATIVE) * ca.fmin(v, 0)
    return forwards + backwards + s.param(COULOMB_FRICTION_NEGATIVE) * ca.fmin(share, 0)
