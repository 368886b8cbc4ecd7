"""A servo-pneumatic rig simulated apart from optid, to judge optid with: nothing here is imported from it.

It differs from optid's plant wherever a simulation can differ while the physics stays that of eqs. 1 to 11:
dry friction with true stick (events at every stop and break-away, after Karnopp) instead of bristles, the
orifice of de Saint Venant and Wantzel with its infinite slope left in, inelastic impacts at the stroke's ends
instead of springs, and Runge-Kutta steps of 10 microseconds instead of an adaptive integrator. A sampled PID
controller in the loop sees the noisy position; the recorded command is what the valve gets.

Each physical element is one small compiled function that takes the whole `Rig`, so physics that optid does
not know is added as fields of `Rig` with null defaults and lines in the element's function.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Rig(NamedTuple):
    """What the rig is made of, SI; pressures absolute. Defaults: table 1 of the paper, Delta excepted."""

    supply_pressure: float = 7e5
    exhaust_pressure: float = 1e5
    atmospheric_pressure: float = 1e5
    temperature: float = 293.0
    heat_ratio: float = 1.4
    gas_constant: float = 287.0
    port_width: float = 6.2e-3
    spool_travel: float = 4e-3
    discharge: float = 0.8
    bore: float = 42e-3
    rod: float = 16e-3
    stroke: float = 0.26
    residual_length: float = 10e-3
    mass: float = 1.9
    viscous: float = 78.0
    coulomb: float = 83.0
    stick_ratio: float = 1.0  # force that breaks away over force that slides
    restitution: float = 0.2  # of the stroke's ends


@dataclass(frozen=True)
class Controller:
    """A sampled PID position controller with limits and a 12-bit output: V, m, s."""

    kp: float = 30.0
    ki: float = 20.0
    kd: float = 0.25
    filter_time: float = 4e-3
    limit: float = 5.0
    quantum: float = 10.0 / 4096


@dataclass(frozen=True)
class Sensors:
    """What the recording adds: noise (sd, m and Pa) and its colour, the AR(1) coefficient."""

    position_noise: float = 0.03e-3
    pressure_noise: float = 500.0
    colour: float = 0.0


@dataclass(frozen=True)
class Run:
    """True signals at the samples, SI: command in volts, `stuck` where dry friction holds the piston."""

    t: Array
    command: Array
    reference: Array
    position: Array
    velocity: Array
    pressure_a: Array
    pressure_b: Array
    stuck: NDArray[np.bool_]
    measured: Array


@njit(cache=True)
def orifice(rig, area, upstream, downstream):
    """Mass flow from upstream to downstream, kg/s: choked below the critical ratio, isentropic above it."""
    K = rig.heat_ratio
    ratio = downstream / upstream
    critical = (2.0 / (K + 1.0)) ** (K / (K - 1.0))
    if ratio <= critical:
        psi = math.sqrt(K * (2.0 / (K + 1.0)) ** ((K + 1.0) / (K - 1.0)))
    else:
        psi = math.sqrt(2.0 * K / (K - 1.0) * max(ratio ** (2.0 / K) - ratio ** ((K + 1.0) / K), 0.0))
    return rig.discharge * area * upstream * psi / math.sqrt(rig.gas_constant * rig.temperature)


@njit(cache=True)
def into_chamber(rig, opening, to_supply, P):
    """Mass flow into a chamber, kg/s, through a port opened by `opening` metres."""
    port = rig.supply_pressure if to_supply else rig.exhaust_pressure
    area = rig.port_width * opening
    return orifice(rig, area, port, P) if port >= P else -orifice(rig, area, P, port)


@njit(cache=True)
def pressure_rates(rig, spool, x, v, Pa, Pb):
    """Energy balance of both chambers with air at constant temperature crossing their bounds, Pa/s."""
    area_a = math.pi / 4.0 * rig.bore**2
    area_b = area_a - math.pi / 4.0 * rig.rod**2
    volume_a = area_a * (rig.stroke / 2.0 + rig.residual_length + x)
    volume_b = area_b * (rig.stroke / 2.0 + rig.residual_length - x)
    heat = rig.gas_constant * rig.temperature
    flow_a = into_chamber(rig, abs(spool), spool > 0.0, Pa)
    flow_b = into_chamber(rig, abs(spool), spool < 0.0, Pb)
    rate_a = rig.heat_ratio / volume_a * (heat * flow_a - Pa * area_a * v)
    rate_b = rig.heat_ratio / volume_b * (heat * flow_b + Pb * area_b * v)
    return rate_a, rate_b


@njit(cache=True)
def drive_force(rig, x, v, Pa, Pb):
    """Everything on the piston except dry friction, N."""
    area_a = math.pi / 4.0 * rig.bore**2
    area_rod = math.pi / 4.0 * rig.rod**2
    air = area_a * Pa - (area_a - area_rod) * Pb - area_rod * rig.atmospheric_pressure
    return air - rig.viscous * v


@njit(cache=True)
def rates(rig, spool, way, x, v, Pa, Pb):
    """d(x, v, Pa, Pb)/dt while sliding in direction `way` (+1 or -1), or held (0)."""
    rate_a, rate_b = pressure_rates(rig, spool, x, v, Pa, Pb)
    if way == 0.0:
        return 0.0, 0.0, rate_a, rate_b
    return v, (drive_force(rig, x, v, Pa, Pb) - way * rig.coulomb) / rig.mass, rate_a, rate_b


@njit(cache=True)
def runge_kutta(rig, spool, way, y, h):
    """One classical fourth-order step."""
    x, v, a, b = y
    x1, v1, a1, b1 = rates(rig, spool, way, x, v, a, b)
    g = h / 2.0
    x2, v2, a2, b2 = rates(rig, spool, way, x + g * x1, v + g * v1, a + g * a1, b + g * b1)
    x3, v3, a3, b3 = rates(rig, spool, way, x + g * x2, v + g * v2, a + g * a2, b + g * b2)
    x4, v4, a4, b4 = rates(rig, spool, way, x + h * x3, v + h * v3, a + h * a3, b + h * b3)
    s = h / 6.0
    return (
        x + s * (x1 + 2.0 * x2 + 2.0 * x3 + x4),
        v + s * (v1 + 2.0 * v2 + 2.0 * v3 + v4),
        a + s * (a1 + 2.0 * a2 + 2.0 * a3 + a4),
        b + s * (b1 + 2.0 * b2 + 2.0 * b3 + b4),
    )


@njit(cache=True)
def excess(rig, y):
    """Force on a piston at rest beyond what dry friction holds, N."""
    return abs(drive_force(rig, y[0], 0.0, y[2], y[3])) - rig.coulomb * rig.stick_ratio


@njit(cache=True)
def way_from_rest(rig, y):
    """Direction in which a piston at rest starts to slide, 0 while dry friction or an end holds it."""
    x, _, a, b = y
    if excess(rig, y) <= 0.0:
        return 0.0
    way = 1.0 if drive_force(rig, x, 0.0, a, b) > 0.0 else -1.0
    return 0.0 if way * x >= rig.stroke / 2.0 else way


@njit(cache=True)
def advance(rig, spool, way, y, h):
    """One step of length h with every stop, break-away and impact in it; the new state and direction."""
    left = h
    for _ in range(8):
        if way == 0.0:
            way = way_from_rest(rig, y)
        new = runge_kutta(rig, spool, way, y, left)
        if way == 0.0:
            if way_from_rest(rig, new) == 0.0:
                y = new
                break
            # Dry friction gives way inside the step: go to that instant.
            before, after = excess(rig, y), excess(rig, new)
            part = left * min(max(before / (before - after), 0.0), 1.0)
            y = runge_kutta(rig, spool, 0.0, y, part)
            way, left = way_from_rest(rig, new), left - part
        elif new[1] * way < 0.0:
            # The piston comes to rest inside the step: go to that instant, where it sticks or turns.
            part = left * y[1] / (y[1] - new[1])
            stopped = runge_kutta(rig, spool, way, y, part)
            y, left = (stopped[0], 0.0, stopped[2], stopped[3]), left - part
            way = 0.0
            if part <= 1e-6 * h:  # it would turn at once: friction holds it for what is left of the step
                y = runge_kutta(rig, spool, 0.0, y, left)
                break
        else:
            y = new
            break
    end = rig.stroke / 2.0
    if abs(y[0]) > end and y[0] * y[1] > 0.0:
        back = -rig.restitution * y[1] if abs(y[1]) > 1e-2 else 0.0
        y = (math.copysign(end, y[0]), back, y[2], y[3])
        way = 0.0 if back == 0.0 else math.copysign(1.0, back)
    return y, way


@njit(cache=True)
def closed_loop(rig, gains, reference, noise, start, dt, steps, out, command, measured):
    """Sample, control, hold: `out` receives x, v, Pa, Pb and the direction of motion at every sample."""
    kp, ki, kd, filter_time, limit, quantum = gains
    y = (start[0], start[1], start[2], start[3])
    way = way_from_rest(rig, y) if y[1] == 0.0 else math.copysign(1.0, y[1])
    integral, slope = 0.0, 0.0
    before = y[0] + noise[0]
    for n in range(len(reference)):
        seen = y[0] + noise[n]
        slope += dt / (filter_time + dt) * ((seen - before) / dt - slope)
        before = seen
        error = reference[n] - seen
        wish = kp * error + ki * integral - kd * slope
        u = min(max(wish, -limit), limit)
        if u == wish or error * wish < 0.0:  # no wind-up at the limits
            integral += error * dt
        u = min(max(quantum * round(u / quantum), -limit), limit)
        out[n, 0], out[n, 1], out[n, 2], out[n, 3], out[n, 4] = y[0], y[1], y[2], y[3], way
        command[n], measured[n] = u, seen
        spool = u / limit * rig.spool_travel
        for _ in range(steps):
            y, way = advance(rig, spool, way, y, dt / steps)


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
    out, command, measured = np.empty((n, 5)), np.empty(n), np.empty(n)
    gains = (
        controller.kp,
        controller.ki,
        controller.kd,
        controller.filter_time,
        controller.limit,
        controller.quantum,
    )
    begin = np.array(balanced(rig) if start is None else start)
    steps = math.ceil(dt / step - 1e-9)
    closed_loop(rig, gains, np.asarray(reference, float), noise, begin, dt, steps, out, command, measured)
    t = np.arange(n) * dt
    return Run(t, command, reference, *out[:, :4].T, stuck=out[:, 4] == 0.0, measured=measured)


def recording(run: Run, rng: np.random.Generator, sensors: Sensors | None = None) -> pd.DataFrame:
    """The table a data acquisition would write: t (s), u (V), x, r (mm), pa, pb (bar absolute)."""
    sensors = sensors or Sensors()
    table = {"t": run.t, "u": run.command, "x": 1e3 * run.measured, "r": 1e3 * run.reference}
    for name, pressure in (("pa", run.pressure_a), ("pb", run.pressure_b)):
        noise = sensors.pressure_noise * unit_noise(len(run.t), sensors.colour, rng)
        table[name] = (pressure + noise) / 1e5
    digits = {"t": 4, "u": 5, "x": 4, "r": 4, "pa": 5, "pb": 5}
    return pd.DataFrame(table).round(digits)


def balanced(rig: Rig) -> tuple[float, float, float, float]:
    """Rest at mid-stroke with no force on the piston, chamber B at 60 % of the way to supply."""
    area_a, area_rod = math.pi / 4 * rig.bore**2, math.pi / 4 * rig.rod**2
    P_b = rig.exhaust_pressure + 0.6 * (rig.supply_pressure - rig.exhaust_pressure)
    P_a = ((area_a - area_rod) * P_b + area_rod * rig.atmospheric_pressure) / area_a
    return 0.0, 0.0, P_a, P_b


def unit_noise(n: int, colour: float, rng: np.random.Generator) -> Array:
    """Gaussian noise of variance 1 with autocorrelation colour**lag."""
    white = rng.normal(size=n)
    if colour == 0.0:
        return white
    noise = np.empty(n)
    noise[0] = white[0]
    for k in range(1, n):
        noise[k] = colour * noise[k - 1] + math.sqrt(1 - colour**2) * white[k]
    return noise
