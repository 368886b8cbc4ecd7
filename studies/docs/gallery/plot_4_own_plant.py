"""
Your own plant, integrated by CasADi
====================================

A slide on a spring, released from 0.3 m: with a proportional spring, and with one whose force is a power of the travel.
`power_law` is an effect for any site; :doc:`/own/plant` writes a plant in full.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import optid
from optid.effects.library import find_effect

GAIN = optid.Parameter("force_gain", "N/V", 20.0, "force per volt", "drive's data sheet")
MASS = optid.Parameter("mass", "kg", 5.0, "of the slide", "a scale")
SPRING = optid.Parameter("spring_rate", "N/m", 200.0, "of the return spring", "a guess")
DRAG = optid.Parameter("viscous_friction", "N s/m", 20.0, "of the guide", "a guess")


def slide(s: optid.Sheet) -> None:
    """Command -> force -> speed -> position."""
    x, v = s.state("position", "m", 0.1), s.state("velocity", "m/s", 0.5)
    spring = s.site("spring.force", s.param(SPRING) * x, unit="N", size=20.0, x=x)
    s.rate(x, v)
    s.rate(v, (s.param(GAIN) * s.input("command", "V") - s.param(DRAG) * v - spring) / s.param(MASS))
    s.output("position", "m", x)


VALUES = {"force_gain": 20.0, "mass": 5.0, "spring_rate": 200.0, "viscous_friction": 20.0}
effect = find_effect("power_law@spring.force", Path())

figure, axes = plt.subplots(layout="constrained")
for effects, own, label in (
    ((), {}, "proportional spring"),
    ((effect,), {f"{effect.name}.exponent": 1.4}, "power law, exponent 1.4"),
):
    functions = optid.build(slide, effects).to_casadi()
    p, x = functions.values({**VALUES, **own}), np.array([0.3, 0.0])
    positions = []
    for _ in range(600):
        positions.append(x[0])
        x = np.array(functions.step(x, 0.0, p, 0.01)).ravel()
    axes.plot(0.01 * np.arange(600), positions, label=label)
axes.set(xlabel="time (s)", ylabel="position (m)")
axes.legend(frameon=False)
plt.show()
