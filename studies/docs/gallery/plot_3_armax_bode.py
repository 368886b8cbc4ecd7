"""
A linear model, beside python-control
=====================================

An ARMAX model of 3 s of the sample bench goes to python-control as a state space.
"""

import control
import matplotlib.pyplot as plt
import numpy as np

import optid

rig, train, _ = optid.datasets.load("bench")
found = optid.identify(train.slice(0.0, 3.0), rig, orders=(2,))
print(found.summary())

# %%
# Its frequency response, by python-control.

system = found.to_control()
omega = np.logspace(0, np.log10(0.9 * np.pi / system.dt), 300)
response = control.frequency_response(system, omega)
figure, (top, bottom) = plt.subplots(2, 1, sharex=True, layout="constrained")
top.loglog(omega / (2 * np.pi), response.magnitude.ravel())
bottom.semilogx(omega / (2 * np.pi), np.degrees(np.unwrap(response.phase.ravel())))
top.set_ylabel("gain (m/V)")
bottom.set(xlabel="frequency (Hz)", ylabel="phase (degrees)")
for axes in (top, bottom):
    axes.grid(which="major", alpha=0.4)
plt.show()
