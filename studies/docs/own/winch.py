"""A plant of one's own: a winch pulls a slide against a spring. Command (V) -> force -> speed -> position (m)."""

import optid
from optid.laws import dry_friction

GAIN = optid.Parameter("force_gain", "N/V", 20.0, "force per volt", "drive's data sheet", bounds=(0.1, 1e3))
MASS = optid.Parameter("mass", "kg", 5.0, "of the slide", "a scale", bounds=(1e-3, 1e4))
DRAG = optid.Parameter("viscous_friction", "N s/m", 20.0, "of the guide", "a guess", bounds=(0.0, 1e4))
SPRING = optid.Parameter("spring_rate", "N/m", 200.0, "of the return spring", "a guess", bounds=(0.0, 1e6))


def winch(s: optid.Sheet) -> None:
    """Write the equations; every `site` is a place where an effect may act."""
    x = s.state("position", "m", 0.1, spread=0.1)
    v = s.state("velocity", "m/s", 0.5, spread=0.5)
    u = s.site("drive.command", s.input("command", "V", idle=0.0), unit="V", size=5.0)
    friction = s.param(DRAG) * v + dry_friction(s, v, "bristle")
    friction = s.site("force.friction", friction, unit="N", v=v)
    spring = s.site("spring.force", s.param(SPRING) * x, unit="N", size=20.0)
    s.rate(x, v)
    s.rate(v, (s.param(GAIN) * u - friction - spring) / s.param(MASS))
    s.output("position", "m", s.site("sensor.position", x, unit="m"))
