"""A plant of one's own: a small servo turns an arm. Goal (rad) -> voltage -> torque -> angle (rad)."""

import casadi as ca

from optid import Parameter, Sheet
from optid.laws import dry_friction

KT = Parameter("torque_constant", "N m/A", 0.4, "and back-emf", "data sheet", bounds=(1e-3, 10.0))
R = Parameter("resistance", "V/A", 4.0, "of the winding", "data sheet", bounds=(0.1, 100.0))
ROTOR = Parameter("armature", "kg m**2", 2e-3, "of the rotor", "a guess", bounds=(1e-6, 1.0))
MASS = Parameter("mass", "kg", 0.5, "at the arm's end", "a scale", bounds=(1e-3, 100.0))
ARM = Parameter("length", "m", 0.1, "of the arm", "a ruler", bounds=(1e-3, 10.0))
ZERO = Parameter("zero_offset", "rad", 0.02, "from hanging down", "the encoder", 0.0, (-0.5, 0.5))
DRAG = Parameter("viscous_friction", "N m s/rad", 4e-3, "of the gear", "a guess", bounds=(0.0, 10.0))


def servo(s: Sheet) -> None:
    """Write the equations; `axis` gives laws for a slide the units of a joint."""
    s.axis("rad", 1.0, "N m", 0.5)
    q, w = s.state("position", "rad", 0.1, spread=0.2), s.state("velocity", "rad/s", 1.0, spread=1.0)
    goal, gain, on = s.input("goal", "rad"), s.input("gain", "1"), s.input("enable", "1")
    duty = (s.site("drive.goal", goal, unit="rad", size=0.5) - q) * gain * 2.877e-3
    volts = s.site("drive.volts", 7.4 * ca.fmin(ca.fmax(duty, -1), 1), unit="V", size=3.0)
    torque, m, arm = on * s.param(KT) * (volts - s.param(KT) * w) / s.param(R), s.param(MASS), s.param(ARM)
    drag = s.param(DRAG) * w + dry_friction(s, w, "bristle", x=q, L=2.0, drive=torque)
    load = s.site("force.external", -9.81 * m * arm * ca.sin(q + s.param(ZERO)), unit="N m", x=q, v=w, L=2.0)
    s.rate(q, w)
    friction = s.site("force.friction", drag, unit="N m", v=w, x=q)
    s.rate(w, (torque - friction + load) / (s.param(ROTOR) + m * arm**2))
    s.output("position", "rad", s.site("sensor.position", q, unit="rad", x=q, v=w, L=2.0))
