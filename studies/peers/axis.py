"""The servo-pneumatic axis of the speed benchmark in plain Python: equations, parameters and a simulation.

Written apart from optid, which imports nothing from here. Smooth dry friction tanh(v / width), the same
smooth flow function and the same stops as optid's plant with ``friction="smooth"``. SI units throughout.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]

# In the order of the enumeration in axis.h. Table 1 of the paper; settings as optid's defaults.
TRUE: dict[str, float] = {
    "supply_pressure": 7e5,
    "exhaust_pressure": 1e5,
    "atmospheric_pressure": 1e5,
    "supply_temperature": 293.0,
    "chamber_temperature": 293.0,
    "specific_heat_ratio": 1.4,
    "gas_constant": 287.0,
    "port_width": 6.2e-3,
    "spool_travel": 4e-3,
    "discharge_coefficient": 0.8,
    "bore_diameter": 42e-3,
    "rod_diameter": 16e-3,
    "stroke": 0.26,
    "residual_length": 10e-3,
    "payload_mass": 1.9,
    "viscous_friction": 78.0,
    "coulomb_friction": 83.0,
    "friction_width": 10e-3,
    "flow_width": 2e-3,
    "stop_stiffness": 1e8,
    "stop_damping": 2.0,
    "length_floor": 5e-4,
}
FREE = ("viscous_friction", "coulomb_friction", "discharge_coefficient")


def rates(_t: float, y: Sequence[float], command: float, p: Mapping[str, float]) -> list[float]:
    """d(x, v, P_a, P_b)/dt under a held command (share of full scale)."""
    x, v, P_a, P_b = y
    K, R, half, residual = p["specific_heat_ratio"], p["gas_constant"], p["stroke"] / 2, p["residual_length"]
    A_a = math.pi / 4 * p["bore_diameter"] ** 2
    A_rod = math.pi / 4 * p["rod_diameter"] ** 2
    A_b = A_a - A_rod
    supply, exhaust = p["supply_pressure"], p["exhaust_pressure"]
    port_a, port_b = (supply, exhaust) if command > 0 else (exhaust, supply)
    length_a, length_b = (soft_floor(half + s + residual, p["length_floor"]) for s in (x, -x))
    heat = R * p["supply_temperature"]
    force = A_a * P_a - A_b * P_b - A_rod * p["atmospheric_pressure"]
    force -= p["viscous_friction"] * v + p["coulomb_friction"] * math.tanh(v / p["friction_width"])
    return [
        v,
        (force + stops(x, v, p)) / p["payload_mass"],
        K / length_a * (-P_a * v + heat / A_a * mass_flow(command, port_a, P_a, p)),
        K / length_b * (+P_b * v + heat / A_b * mass_flow(command, port_b, P_b, p)),
    ]


def mass_flow(command: float, port: float, P: float, p: Mapping[str, float]) -> float:
    """Flow into a chamber, kg/s: eqs. 1 to 8 with a laminar region at equal pressures."""
    K, R = p["specific_heat_ratio"], p["gas_constant"]
    C_0 = math.sqrt(K / R * (2 / (K + 1)) ** ((K + 1) / (K - 1)))
    C_k2 = 2 / (K - 1) * ((K + 1) / 2) ** ((K + 1) / (K - 1))
    upstream, downstream = max(port, P), min(port, P)
    ratio = max(downstream / upstream, (2 / (K + 1)) ** (K / (K - 1)))
    f2 = C_k2 * (ratio ** (2 / K) - ratio ** ((K + 1) / K))
    f = f2 / (f2 * f2 + p["flow_width"] ** 2) ** 0.25
    area = p["port_width"] * p["spool_travel"] * abs(command)
    into = port > P
    T = p["supply_temperature"] if into else p["chamber_temperature"]
    flow = p["discharge_coefficient"] * C_0 * area * upstream / math.sqrt(T) * f
    return flow if into else -flow


def soft_floor(length: float, floor: float) -> float:
    """max(length, floor), rounded over half a floor to each side, m."""
    width = floor / 2
    if length > floor + width:
        return length
    return floor if length < floor - width else (length - floor + width) ** 2 / (4 * width) + floor


def stops(x: float, v: float, p: Mapping[str, float]) -> float:
    """Hunt and Crossley's contact force of the stroke's ends, N."""
    low, high = max(-p["stroke"] / 2 - x, 0.0), max(x - p["stroke"] / 2, 0.0)
    k, c = p["stop_stiffness"], p["stop_damping"]
    push_low = k * low * math.sqrt(low + 1e-12) * max(1 - c * v, 0.0)
    return push_low - k * high * math.sqrt(high + 1e-12) * max(1 + c * v, 0.0)


def simulate(
    p: Mapping[str, float],
    start: Sequence[float],
    commands: Array,
    dt: float,
    *,
    method: str = "Radau",
    rtol: float = 1e-10,
    atol: Sequence[float] = (1e-12, 1e-10, 1e-5, 1e-5),
    restart: bool = True,
) -> Array:
    """States at the samples, shape (n + 1, 4), by SciPy's adaptive integrators.

    Args:
        p: parameters, SI.
        start: x, v, P_a, P_b at the first sample.
        commands: held commands as shares of full scale, shape (n,).
        dt: sample time, s.
        method: of `scipy.integrate.solve_ivp`.
        rtol: relative tolerance.
        atol: absolute tolerances of the four states.
        restart: at every held command; otherwise one call runs over all jumps.
    """
    n = len(commands)
    if not restart:
        held = commands.tolist()

        def switched(t: float, y: Sequence[float]) -> list[float]:
            return rates(t, y, held[min(int(t / dt), n - 1)], p)

        t = np.arange(n + 1) * dt
        run = solve_ivp(switched, (0.0, t[-1]), start, method=method, t_eval=t, rtol=rtol, atol=atol)
        return np.asarray(run.y.T)
    states = np.empty((n + 1, 4))
    states[0] = start
    for k, command in enumerate(commands.tolist()):
        run = solve_ivp(rates, (0.0, dt), states[k], method=method, rtol=rtol, atol=atol, args=(command, p))
        states[k + 1] = run.y[:, -1]
    return states
