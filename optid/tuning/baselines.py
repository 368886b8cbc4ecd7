"""Baseline gains for the same plant: classical rules, an optimal regulator, a local search."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from optid.core.model import Array
from optid.pid.controller import Gains
from optid.tuning.plant import Plant
from optid.tuning.reaction_curve import Reaction, reaction
from optid.tuning.search import GainBounds
from optid.tuning.ultimate import Ultimate

# The paper's gains, section 6, in unstated units: interpreted for an error in metres, and for one in centimetres.
PAPER = (16.0, 6.0, 0.001)


@dataclass(frozen=True)
class Baseline:
    """A rule's name, its gains (None where it does not apply to this plant), and a note on it."""

    name: str
    gains: Gains | None
    note: str


def _series(kp: float, Ti: float, Td: float, tau: float, b: float = 1.0) -> Gains:
    """From gain, integral and derivative time."""
    return Gains(kp, kp / Ti if Ti > 0 else 0.0, kp * Td, tau, b)


def ziegler_nichols(r: Reaction, tau: float) -> Gains:
    """From the reaction curve: 1.2/(R L), 2 L, L/2 (Ziegler and Nichols 1942)."""
    return _series(1.2 / (r.slope * r.delay), 2.0 * r.delay, 0.5 * r.delay, tau)


def ziegler_nichols_ultimate(u: Ultimate, tau: float) -> Gains:
    """From ultimate gain and period: 0.6 Ku, Tu/2, Tu/8 (Ziegler and Nichols 1942)."""
    return _series(0.6 * u.gain, 0.5 * u.period, 0.125 * u.period, tau)


def cohen_coon(r: Reaction, tau: float) -> Gains:
    """Cohen and Coon 1953, as written by Astrom and Hagglund 2006, table 2.3; an integrator is its limit."""
    share = 0.0 if r.integrating else r.delay / (r.delay + r.lag)
    kp = 1.35 / (r.slope * r.delay) * (1.0 + 0.18 * share / (1.0 - share))
    Ti = (2.5 - 2.0 * share) / (1.0 - 0.39 * share) * r.delay
    return _series(kp, Ti, (0.37 - 0.37 * share) / (1.0 - 0.81 * share) * r.delay, tau)


def amigo(r: Reaction, tau: float) -> Gains:
    """Approximate M-constrained integral gain optimisation (Astrom and Hagglund 2006, section 7.4)."""
    L, T = r.delay, r.lag
    if r.integrating:
        return _series(0.45 / (r.gain * L), 8.0 * L, 0.5 * L, tau, b=0.0)
    kp = (0.2 + 0.45 * T / L) / r.gain
    Ti = (0.4 * L + 0.8 * T) / (L + 0.1 * T) * L
    return _series(kp, Ti, 0.5 * L * T / (0.3 * L + T), tau, b=0.0 if L < T else 1.0)


def simc(r: Reaction, tau: float) -> Gains:
    """Skogestad's PI with a closed-loop time constant equal to the delay (J. Process Control 13, 2003)."""
    return _series(0.5 / (r.slope * r.delay), min(r.lag, 8.0 * r.delay), 0.0, tau)


def regulator(r: Reaction, size: float, most: float, tau: float) -> Gains:
    """python-control's linear-quadratic regulator of integral, output and speed, weighted by their allowed sizes.

    Args:
        r: reaction curve of the plant; its delay counts as a lag of the speed.
        size: of the set-point.
        most: largest command.
        tau: time constant of the derivative's lag.
    """
    import control

    if r.integrating:
        lag = r.delay
        A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0 / lag]])
        B, time = np.array([[0.0], [0.0], [r.gain / lag]]), 4.0 * r.delay
        Q = np.diag([1.0 / (size * time) ** 2, 1.0 / size**2, (0.1 * time / size) ** 2])
    else:
        A, B = np.array([[0.0, 1.0], [0.0, -1.0 / r.lag]]), np.array([[0.0], [r.gain / r.lag]])
        Q = np.diag([1.0 / (size * 4.0 * r.delay) ** 2, 1.0 / size**2])
    K = np.asarray(control.lqr(A, B, Q, np.array([[1.0 / most**2]]))[0]).ravel()
    return Gains(float(K[1]), float(K[0]), float(K[2]) if r.integrating else 0.0, tau)


def nelder_mead(fitness: Callable[[Array], Array], within: GainBounds, start: Gains) -> Gains:
    """The simplex search on the same cost, from a rule's gains: it reaches a local optimum at best."""
    from scipy.optimize import minimize

    def one(point: Array) -> float:
        return float(min(fitness(np.clip(point, 0.0, 1.0)[None])[0], 1e300))

    found = minimize(one, within.points(start.vector)[0], method="Nelder-Mead", options={"maxfev": 400})
    return Gains(*within.gains(np.clip(found.x, 0.0, 1.0))[0].tolist())


def rules(plant: Plant, scale: Ultimate, size: float, most: float, tau: float) -> list[Baseline]:
    """All rules that need no search.

    Args:
        plant: to be controlled.
        scale: its ultimate gain and period.
        size: of the set-point; most: largest command.
        tau: time constant of the derivative's lag, the same for all.
    """
    curve = reaction(plant, scale)
    silent = "the step response neither settles nor rises steadily"
    found = []
    for name, rule, note in (
        ("ziegler_nichols", ziegler_nichols, "reaction curve"),
        ("cohen_coon", cohen_coon, "reaction curve"),
        ("amigo", amigo, "reaction curve"),
        ("simc", simc, "reaction curve; PI"),
        ("python_control", lambda r, t: regulator(r, size, most, t), "linear-quadratic regulator"),
    ):
        found.append(Baseline(name, None if curve is None else rule(curve, tau), note if curve else silent))
    found.insert(
        1, Baseline("ziegler_nichols_ultimate", ziegler_nichols_ultimate(scale, tau), "ultimate gain")
    )
    for name, factor in (("paper", 1.0), ("paper_per_cm", 100.0)):
        kp, ki, kd = (factor * value * plant.sign for value in PAPER)
        found.append(
            Baseline(
                name, Gains(kp, ki, kd, tau), f"the paper's gains, error in {'m' if factor == 1 else 'cm'}"
            )
        )
    return found
