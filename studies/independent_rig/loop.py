"""The rig in its loop: sampled, controlled and held; and the rig alone, replaying a command."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from studies.independent_rig.integrate import advance, way_from_rest
from studies.independent_rig.recording import unit_noise
from studies.independent_rig.rig import Array, Controller, Rig, Run, Sensors, balanced, packed
from studies.independent_rig.sensor import reading
from studies.independent_rig.states import (
    COUNT,
    CREEP_A,
    CREEP_B,
    GEAR,
    GOAL,
    PA,
    PB,
    PE,
    PS,
    SEEN,
    SEEN2,
    SMOOTH,
    TA,
    TB,
    WAY,
    X2,
    V,
    X,
)
from studies.independent_rig.valve import target

BASE_STATES = 4
BEYOND = (
    "wall_heat",
    "reservoir",
    "silencer",
    "valve_order",
    "sensor_order",
    "load_share",
    "creep",
)


@njit(cache=True)
def interval(rig, y, share, clock, work):
    """From one sample to the next: `share` is the commands at this and earlier samples; reads ahead of none.

    `clock` is the number of the sample, its length in s, steps in it, and by how many steps commands come late.
    """
    n, dt, steps, late = clock
    h = dt / steps
    before = np.int64(-(10**9))
    for j in range(steps):
        current = (n * steps + j - late) // steps
        if current != before:
            y[GOAL] = target(rig, share[current] if current >= 0 else 0.0, y)
            before = current
        advance(rig, n * dt + j * h, y, h, work)


@njit(cache=True)
def closed_loop(rig, gains, reference, noise, clock, y, work, out, command, signals):
    """Sample, control, hold: `out` receives the states at every sample, `signals` what the sensor says."""
    kp, ki, kd, filter_time, limit, quantum, position_quantum = gains
    dt, steps, late = clock
    integral, slope = 0.0, 0.0
    share = np.zeros(len(reference))
    before = 0.0
    for n in range(len(reference)):
        clean = reading(rig, n * dt, y, share[n - 1] if n > 0 else 0.0)
        seen = clean + noise[n]
        if position_quantum > 0.0:
            seen = position_quantum * round(seen / position_quantum)
        if n == 0:
            before = seen
        slope += dt / (filter_time + dt) * ((seen - before) / dt - slope)
        before = seen
        error = reference[n] - seen
        wish = kp * error + ki * integral - kd * slope
        u = min(max(wish, -limit), limit)
        if u == wish or error * wish < 0.0:  # no wind-up at the limits
            integral += error * dt
        u = min(max(quantum * round(u / quantum), -limit), limit)
        out[n] = y
        command[n], share[n] = u, u / limit
        signals[n, 0], signals[n, 1] = clean, seen
        interval(rig, y, share, (n, dt, steps, late), work)


@njit(cache=True)
def open_loop(rig, share, clock, y, first, work, out, clean):
    """Replay commands (shares of full scale) from sample `first` on, into as many rows as `out` has."""
    dt, steps, late = clock
    for n in range(first, first + len(out)):
        out[n - first] = y
        clean[n - first] = reading(rig, n * dt, y, share[n - 1] if n > 0 else 0.0)
        if n < first + len(out) - 1:
            interval(rig, y, share, (n, dt, steps, late), work)


def simulate(
    rig: Rig,
    reference: Array,
    rng: np.random.Generator,
    *,
    controller: Controller | None = None,
    sensors: Sensors | None = None,
    dt: float = 1e-3,
    step: float = 10e-6,
    start: tuple[float, float, float, float] | None = None,
) -> Run:
    """Run the closed loop along a reference (m, one value per sample).

    Args:
        rig: the rig.
        reference: wanted position, m, shape (n,).
        rng: source of the noise.
        controller: gains; a controller with all gains zero holds the command at zero.
        sensors: noise of the position sensor, which the controller sees too.
        dt: sample time, s.
        step: longest integration step, s.
        start: x, v, Pa, Pb; by default at rest at mid-stroke with balanced pressures.
    """
    controller, sensors = controller or Controller(), sensors or Sensors()
    n = len(reference)
    noise = sensors.position_noise * unit_noise(n, sensors.colour, rng)
    out, command, signals = np.empty((n, COUNT)), np.empty(n), np.empty((n, 2))
    gains = (
        controller.kp,
        controller.ki,
        controller.kd,
        controller.filter_time,
        controller.limit,
        controller.quantum,
        sensors.quantum,
    )
    y = state(rig, balanced(rig) if start is None else start)
    clock = _clock(rig, dt, step, sensors.skew)
    reference = np.asarray(reference, float)
    closed_loop(packed(rig), gains, reference, noise, clock, y, _work(rig), out, command, signals)
    return Run(
        np.arange(n) * dt,
        command,
        reference,
        *out[:, :4].T,
        out[:, WAY] == 0.0,
        signals[:, 1],
        signals[:, 0],
        out,
    )


def replay(
    rig: Rig,
    share: Array,
    y: Array,
    first: int,
    count: int,
    *,
    skew: float = 0.0,
    dt: float = 1e-3,
    step: float = 10e-6,
) -> tuple[Array, Array]:
    """The rig without its controller: states (count, COUNT) and the sensor's clean reading, m, (count,).

    Args:
        rig: the rig.
        share: command at every sample of a recording, share of full scale, shape (n,).
        y: full state at sample `first`.
        first: where to begin.
        count: samples to give.
        skew: s by which the command changes after the sample.
        dt: sample time, s.
        step: longest integration step, s.
    """
    out, clean = np.empty((count, COUNT)), np.empty(count)
    share = np.asarray(share, float)
    open_loop(packed(rig), share, _clock(rig, dt, step, skew), y.copy(), first, _work(rig), out, clean)
    return out, clean


def state(rig: Rig, start: tuple[float, float, float, float]) -> Array:
    """The full state that goes with x, v, Pa, Pb: everything else settled."""
    y = np.zeros(COUNT)
    y[X], y[V], y[PA], y[PB] = start
    y[TA] = y[TB] = rig.temperature
    y[PS], y[PE] = rig.supply_pressure, rig.exhaust_pressure
    y[[X2, SEEN, SEEN2, GEAR]] = y[X]
    y[CREEP_A], y[CREEP_B] = y[PA], y[PB]
    y[GOAL] = rig.valve_offset
    way = way_from_rest(packed(rig), 0.0, y, y)
    y[WAY] = way if y[V] == 0.0 else math.copysign(1.0, y[V])
    return y


def _clock(rig: Rig, dt: float, step: float, skew: float) -> tuple[float, int, int]:
    steps = math.ceil(dt / step - 1e-9)
    return dt, steps, round((rig.delay + skew) / dt * steps)


def _work(rig: Rig) -> tuple[Array, int]:
    """Rows to work in, and how many states have equations: the base ones alone are faster."""
    beyond = any(getattr(rig, name) != 0.0 for name in BEYOND)
    return np.zeros((6, SMOOTH)), SMOOTH if beyond else BASE_STATES
