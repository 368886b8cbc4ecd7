"""A Dynamixel XL330 that turns an arm: goal (rad) -> duty of the bridge -> voltage -> torque -> angle (rad).

The teeth are pressed by the motor and, where the efficiency from the load's side is another, by a share `load_side`
of what the load brings: effects that grow with the transmitted torque see both.
"""

import casadi as ca

from optid import Parameter, Sheet
from optid.laws import dry_friction

SHEET = "Dynamixel e-manual, XL330-M288"
BAM = "Duclusaud and Passault, Extended friction models for the physics simulation of servo actuators, 2024"
POSITIVE = (1e-9, 1e3)

KT = Parameter("torque_constant", "N m/A", 0.35, "and back-emf, with the gear", BAM, bounds=POSITIVE)
R = Parameter("resistance", "V/A", 3.5, "of the winding", BAM, bounds=POSITIVE)
ROTOR = Parameter("armature", "kg m**2", 2e-3, "of the rotor, with the gear", BAM, bounds=POSITIVE)
SUPPLY = Parameter("supply_voltage", "V", 7.4, "before the bridge", BAM, bounds=POSITIVE)
DUTY = Parameter("duty_gain", "1/rad", 3e-3, "duty per error and unit of gain", SHEET, bounds=POSITIVE)
MASS = Parameter("payload_mass", "kg", 0.5, "at the arm's end", BAM, bounds=POSITIVE)
ARM = Parameter("arm_length", "m", 0.1, "to that mass", BAM, bounds=POSITIVE)
ZERO = Parameter("zero_offset", "rad", 0.02, "of the encoder from hanging down", BAM, 0.0, (-0.5, 0.5))
DRAG = Parameter("viscous_friction", "N m s/rad", 5e-3, "of the gear", BAM, bounds=(0.0, 10.0))
BACK = Parameter(
    "load_side", "1", 0.5, "share of the load's torque in what presses the teeth", BAM, 1.0, (0.0, 3.0)
)


def servo(s: Sheet) -> None:
    """Write the equations."""
    s.axis("rad", 1.0, "N m", 0.5)
    q, w = s.state("position", "rad", 0.1, spread=0.2), s.state("velocity", "rad/s", 1.0, spread=1.0)
    goal, gain, on = s.input("goal", "rad"), s.input("gain", "1"), s.input("enable", "1")
    duty = (s.site("drive.goal", goal, size=0.5) - q) * gain * s.param(DUTY)
    volts = s.site("drive.volts", s.param(SUPPLY) * ca.fmin(ca.fmax(duty, -1), 1), size=3.0)
    torque = on * s.param(KT) * (volts - s.param(KT) * w) / s.param(R)
    weight = s.param(MASS) * 9.80665 * s.param(ARM) * ca.sin(q + s.param(ZERO))
    pressing = torque + s.param(BACK) * weight
    drag = s.param(DRAG) * w + dry_friction(s, w, "bristle", x=q, L=2.0, drive=pressing)
    load = s.site("force.external", -weight, x=q, v=w, L=2.0)
    inertia = s.param(ROTOR) + s.param(MASS) * s.param(ARM) ** 2
    s.rate(q, w)
    s.rate(w, (torque - s.site("force.friction", drag, v=w, x=q) + load) / inertia)
    s.output("position", "rad", s.site("sensor.position", q, x=q, v=w, L=2.0))
