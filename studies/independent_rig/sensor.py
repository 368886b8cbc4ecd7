"""What the position sensor says of the piston's position, noise apart."""

import math

from numba import njit

from studies.independent_rig.motion import drifted
from studies.independent_rig.states import GEAR, SEEN, SEEN2, V, X

TRACK = 1.3e-3  # m: roughness of a potentiometer's track on which a fast wiper bounces


@njit(cache=True)
def geared(rig, x, y):
    """Position of the sensor's gear, m, which follows the piston with play; `y` is where the step began."""
    return min(max(y[GEAR], x - rig.backlash), x + rig.backlash) if rig.backlash > 0.0 else x


@njit(cache=True)
def filter_rates(rig, s, y, dy):
    """The sensor's filter: one or two equal lags."""
    if rig.sensor_order == 0.0:
        dy[SEEN], dy[SEEN2] = 0.0, 0.0
        return
    dy[SEEN] = (geared(rig, s[X], y) - s[SEEN]) / rig.sensor_time
    dy[SEEN2] = (s[SEEN] - s[SEEN2]) / rig.sensor_time


@njit(cache=True)
def reading(rig, t, y, share):
    """Position as the sensor gives it, m; `share` is the command that couples into its cable."""
    at = geared(rig, y[X], y)
    if rig.sensor_order == 1.0:
        at = y[SEEN]
    elif rig.sensor_order == 2.0:
        at = y[SEEN2]
    if rig.bend > 0.0:
        turn = 2.0 * math.pi * at / rig.bend_pitch + rig.bend_phase
        at += rig.bend * (math.sin(turn) + 0.3 * math.sin(2.0 * turn))
    if rig.sensor_drift != 0.0:
        at += drifted(rig.sensor_drift, rig.sensor_drift_time, t)
    if rig.crosstalk != 0.0:
        at += rig.crosstalk * share
    if rig.bounce > 0.0 and abs(y[V]) > rig.bounce_speed:
        off = min(abs(y[V]) / rig.bounce_speed - 1.0, 1.0)
        at += rig.bounce * off * math.sin(2.0 * math.pi * y[X] / TRACK)
    return at
