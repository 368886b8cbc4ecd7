"""A user's own plant: a vertical cylinder lifts a hanging mass; one chamber's pressure is measured, the other's is not.

A rig file names it as `model = "hanging_cylinder.py:hanging_cylinder"`. What moves the mass is measured, so that
valve and air stay outside:

    M x'' = (p - p_0) A - M g - F_v x' - F_c s

with s from -1 to 1 as `optid.rigs.friction` says. The unmeasured chamber is taken to stand at ambient pressure.
"""

from __future__ import annotations

import math

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.rigs.friction import dry_friction

FILE = "wbident's recording of a vertical cylinder: bore 25 mm, rod 5 mm, stroke 125 mm, 1.469 kg"
GRAVITY = 9.81  # m/s2
MIDDLE, TRAVEL = 0.0625, 0.125  # m: what an effect that follows the position counts from
POSITIVE = (1e-12, math.inf)

AMBIENT = Parameter("atmospheric_pressure", "Pa", 1e5, "pressure outside, p_0", FILE, 1e5, POSITIVE)
AREA = Parameter(
    "piston_area", "m**2", 5e-4, "area that the measured pressure acts on, A", FILE, bounds=POSITIVE
)
MASS = Parameter("hanging_mass", "kg", 1.5, "of the weight, piston and rod, M", FILE, bounds=POSITIVE)
VISCOUS = Parameter("viscous_friction", "N s/m", 50.0, "F_v", FILE, bounds=(0.0, 1e5))


def hanging_cylinder(s: Sheet) -> None:
    """Pressure of the lifting chamber (Pa, absolute) -> force -> speed -> position (m, upwards)."""
    x = s.state("position", "m", 0.01, start=MIDDLE, spread=TRAVEL)
    v = s.state("velocity", "m/s", 0.1, spread=0.5)
    p = s.input("pressure", "Pa")
    lift = s.site("drive.pressure", (p - s.param(AMBIENT)) * s.param(AREA), unit="N", size=100.0, v=v)
    viscous = s.site("force.viscous", s.param(VISCOUS) * v, unit="N", v=v)
    drag = s.site(
        "force.friction", viscous + dry_friction(s, v, "bristle", x=x - MIDDLE, L=TRAVEL), unit="N", v=v
    )
    mass = s.param(MASS)
    external = s.site("force.external", -mass * GRAVITY, unit="N", x=x - MIDDLE, v=v, L=TRAVEL)
    s.rate(x, v)
    s.rate(v, (lift - drag + external) / mass)
    s.output("position", "m", s.site("sensor.position", x, unit="m", x=x - MIDDLE, v=v, L=TRAVEL))
