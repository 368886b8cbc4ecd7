"""From command to openings: what stands between the amplifier and the four edges of the spool."""

import math

from numba import njit

from studies.independent_rig.states import PLAY, RATE, SHARES, SPOOL, STOOD


@njit(cache=True)
def target(rig, share, y):
    """Where the spool is sent by a command (share of full scale); its memories in `y` move on."""
    if rig.valve_stiction > 0.0:
        if abs(share - y[STOOD]) > rig.valve_stiction:
            y[STOOD] = share
        share = y[STOOD]
    if rig.valve_hysteresis > 0.0:
        total = 0.0
        for k in range(len(SHARES)):
            width = rig.valve_hysteresis * SHARES[k]
            y[PLAY + k] = min(max(y[PLAY + k], share - width), share + width)
            total += y[PLAY + k]
        share = total / len(SHARES)
    return share + rig.valve_offset


@njit(cache=True)
def spool_rates(rig, goal, s, dy):
    """A spool of first or second order with a limited rate."""
    if rig.valve_order == 1.0:
        pace = rig.valve_frequency * (goal - s[SPOOL])
        dy[SPOOL] = min(max(pace, -rig.valve_rate), rig.valve_rate)
        dy[RATE] = 0.0
    elif rig.valve_order == 2.0:
        w = rig.valve_frequency
        dy[RATE] = w * w * (goal - s[SPOOL]) - 2.0 * rig.valve_damping * w * s[RATE]
        dy[SPOOL] = min(max(s[RATE], -rig.valve_rate), rig.valve_rate)
    else:
        dy[SPOOL], dy[RATE] = 0.0, 0.0


@njit(cache=True)
def spool(rig, goal, s):
    """Share of full travel at which the spool stands."""
    at = s[SPOOL] if rig.valve_order > 0.0 else goal
    return min(max(at, -rig.limit_down), rig.limit_up)


@njit(cache=True)
def opening(rig, way, overlap):
    """Opening of an edge, m, when the spool has gone `way` (m) towards opening it.

    An edge with a radius opens quadratically; one with a clearance never closes (Ellman's root).
    """
    at = way - overlap * rig.spool_travel
    if rig.edge_round > 0.0:
        r = rig.edge_round * rig.spool_travel
        at = 0.0 if at <= 0.0 else at * at / (2.0 * r) if at < r else at - r / 2.0
    at = max(at, 0.0)
    if rig.clearance > 0.0:
        at = math.sqrt(at * at + (rig.clearance * rig.spool_travel) ** 2)
    return at
