"""A servo-pneumatic rig simulated apart from optid, to judge optid with: nothing here is imported from it.

It differs from optid's plant wherever a simulation can differ while the physics stays that of eqs. 1 to 11:
dry friction with true stick (events at every stop and break-away, after Karnopp) instead of bristles, the
orifice of de Saint Venant and Wantzel with its infinite slope left in, inelastic impacts at the stroke's ends
instead of springs, and Runge-Kutta steps of 10 microseconds instead of an adaptive integrator. A sampled PID
controller in the loop sees the noisy position; the recorded command is what the valve gets.

Physics that the base equations leave out are fields of `Rig` with null defaults and lines in the element they
belong to: `valve.py`, `air.py`, `motion.py`, `sensor.py`. Where nature leaves a choice of form, the one that a
catalogue would not write first is taken.

Compiled functions are cached by file: after a change to one file, remove `__pycache__`, or its callers keep the old.
"""

from studies.independent_rig.air import orifice
from studies.independent_rig.loop import replay, simulate
from studies.independent_rig.recording import recording, unit_noise
from studies.independent_rig.rig import Controller, Rig, Run, Sensors, balanced

__all__ = [
    "Controller",
    "Rig",
    "Run",
    "Sensors",
    "balanced",
    "orifice",
    "recording",
    "replay",
    "simulate",
    "unit_noise",
]
