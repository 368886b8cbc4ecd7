"""The equation residual: what force is missing in eq. 11 when position and pressures are put into it.

Position is smoothed by local polynomials, which gives speed and acceleration; pressures are the measured ones, or,
without sensors, those of eqs. 1 to 10 along the smoothed motion with the fitted parameters.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.signal import savgol_filter

from optid.core.model import Array
from optid.core.recording import Recording

SPAN = 41  # samples of a local polynomial of third degree
REST = 2e-3  # m/s below which a piston may be held by friction: no equation there
CHOKED = 0.6847  # sqrt(K) (2 / (K + 1))^((K + 1) / (2 (K - 1))) of air


@dataclass(frozen=True, eq=False)
class Motion:
    """Along one recording, SI: t, x, v, acceleration, command, pressures, missing force; where the piston slides."""

    t: Array
    x: Array
    v: Array
    a: Array
    u: Array
    P_a: Array
    P_b: Array
    force: Array
    slides: Array


def motion_of(recording: Recording, p: Mapping[str, float]) -> Motion:
    """Put a recording into eq. 11 with parameters `p`."""
    t, u = np.asarray(recording.time), np.asarray(recording["command"].values)
    raw = np.asarray(recording["position"].values)
    known = np.isfinite(raw)
    y = np.interp(t, t[known], raw[known])
    x, v, a = (savgol_filter(y, SPAN, 3, deriv=n, delta=recording.interval) for n in range(3))
    area_a, area_rod = np.pi / 4 * p["bore_diameter"] ** 2, np.pi / 4 * p["rod_diameter"] ** 2
    if "pressure_a" in recording:
        P_a, P_b = (savgol_filter(np.asarray(recording[f"pressure_{c}"].values), SPAN, 3) for c in "ab")
    else:
        P_a, P_b = followed(t, x, v, u, p)
    air = area_a * P_a - (area_a - area_rod) * P_b - area_rod * p["atmospheric_pressure"]
    known_force = air - p["viscous_friction"] * v - p["coulomb_friction"] * np.sign(v)
    slides = np.abs(v) > REST
    slides[: SPAN // 2] = slides[-SPAN // 2 :] = False
    return Motion(t, x, v, a, u, P_a, P_b, p["payload_mass"] * a - known_force, slides)


def followed(t: Array, x: Array, v: Array, u: Array, p: Mapping[str, float]) -> tuple[Array, Array]:
    """Pressures of eqs. 1 to 10 along a known motion, from balance at rest; ten Euler steps per sample."""
    area_a, area_rod = np.pi / 4 * p["bore_diameter"] ** 2, np.pi / 4 * p["rod_diameter"] ** 2
    area_b = area_a - area_rod
    P_b = p["exhaust_pressure"] + 0.6 * (p["supply_pressure"] - p["exhaust_pressure"])
    P_a = (area_b * P_b + area_rod * p["atmospheric_pressure"]) / area_a
    out = np.empty((len(t), 2))
    heat, K = p["gas_constant"] * p["supply_temperature"], p["specific_heat_ratio"]
    length = p["stroke"] / 2 + p["residual_length"]
    h = (t[1] - t[0]) / 10
    for n in range(len(t)):
        out[n] = P_a, P_b
        opening = abs(u[n]) * p["spool_travel"] * p["port_width"] * p["discharge_coefficient"]
        port_a, port_b = p["supply_pressure"], p["exhaust_pressure"]
        if u[n] < 0:
            port_a, port_b = port_b, port_a
        for _ in range(10):
            flow_a, flow_b = flow(opening, port_a, P_a, heat), flow(opening, port_b, P_b, heat)
            P_a += h * K / (area_a * (length + x[n])) * (heat * flow_a - P_a * area_a * v[n])
            P_b += h * K / (area_b * (length - x[n])) * (heat * flow_b + P_b * area_b * v[n])
            P_a, P_b = (min(max(P, 0.5e5), 1.2 * p["supply_pressure"]) for P in (P_a, P_b))
    return out[:, 0], out[:, 1]


def flow(area: float, port: float, P: float, heat: float) -> float:
    """Mass flow into a chamber, kg/s: ISO 6358 with b = 0.528."""
    high, low = max(port, P), min(port, P)
    over = max((low / high - 0.528) / 0.472, 0.0)
    return float(np.sign(port - P) * area * high * CHOKED / np.sqrt(heat) * np.sqrt(max(1 - over**2, 0.0)))
