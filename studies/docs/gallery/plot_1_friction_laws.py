"""
Friction that sticks: the curve of an effect
============================================

The law of `stribeck_friction` holds the curves in use, from an exponential to Hess and Soom's. The effect itself is
asked for its curve: an effect is a function of a signal and its parameters.
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import optid
from optid.effects.library import built_in

effect = built_in()["stribeck_friction"]
speed = np.linspace(-0.1, 0.1, 401)
v = ca.SX.sym("v")

# %%
# A sheet gives the symbols of the parameters; the effect writes its law on it.

sheet = optid.Sheet("curve", ())
law = effect.apply("force.breakaway", ca.SX(80.0), {"v": v}, sheet)
symbols = [sheet.param(q) for q in effect.parameters]
curve = ca.Function("curve", [v, *symbols], [law])

figure, axes = plt.subplots(layout="constrained")
for exponent, tail, label in ((1.0, 0.01, "exponential"), (2.0, 0.01, "Gauss"), (2.0, 1.0, "Hess and Soom")):
    force = np.array(curve(speed, 1.6, 0.02, exponent, tail)).ravel()
    axes.plot(1e3 * speed, force, label=label)
axes.set(xlabel="speed (mm/s)", ylabel="steady friction (N)")
axes.set_title("Stribeck's curve: breakaway 1.6 times 80 N, Stribeck speed 20 mm/s", fontsize=10)
axes.legend(frameon=False)
plt.show()
