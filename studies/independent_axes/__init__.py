"""A rotary and a hydraulic servo axis simulated apart from optid, to judge it with: nothing is imported from it.

Other formulations than optid's plants: momenta instead of speeds, the content of a chamber (the volume that its oil
would have without pressure, from which the pressure follows) instead of pressures, dry friction that truly sticks,
with events at every stop and break-away, and classical Runge-Kutta steps of 20 microseconds. A sampled PID controller
in the loop sees the noisy position; the recorded command is what the drive or the valve gets.

Physics that the base equations leave out are fields with null defaults, as in `studies/independent_rig`.
"""

from studies.independent_axes.hydraulic import Hydraulic
from studies.independent_axes.loop import Axis, Run, simulate
from studies.independent_axes.rotary import Rotary

__all__ = ["Axis", "Hydraulic", "Rotary", "Run", "simulate"]
