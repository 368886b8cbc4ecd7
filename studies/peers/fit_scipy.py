"""The route most people would take: SciPy's `solve_ivp` (LSODA) inside SciPy's `least_squares`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from studies.peers.axis import FREE, Array, simulate


@dataclass(frozen=True)
class SciPyFit:
    """Fitted parameters (SI), sum of squared errors (m2) and simulations of the record."""

    parameters: dict[str, float]
    cost: float
    simulations: int


def fit(
    p: Mapping[str, float],
    start: Sequence[float],
    commands: Array,
    positions: Array,
    dt: float,
    *,
    restart: bool = True,
    rtol: float = 1e-6,
) -> SciPyFit:
    """Fit `FREE` from the values in `p`; arguments as those of `studies.peers.fit_c.fit`.

    Args:
        p: parameters, SI; the free ones are start values.
        start: x, v, P_a, P_b at the first sample.
        commands: held commands as shares of full scale, shape (n,).
        positions: measured positions, m, shape (n,).
        dt: sample time, s.
        restart: the integrator at every held command. Without it a run takes two thirds of the time, but its
            steps straddle the commands' jumps, finite differences see noise, and the fit ends tens of percent
            off the truth.
        rtol: relative tolerance of LSODA.
    """
    scale = np.array([p[name] for name in FREE])
    runs = 0

    def residual(theta: Array) -> Array:
        nonlocal runs
        runs += 1
        trial = {**p, **dict(zip(FREE, (theta * scale).tolist(), strict=True))}
        atol = (1e-9, 1e-7, 1e-1, 1e-1)
        states = simulate(
            trial, start, commands[:-1], dt, method="LSODA", rtol=rtol, atol=atol, restart=restart
        )
        return np.asarray(states[:, 0] - positions)

    solved = least_squares(residual, np.ones(len(FREE)), bounds=(0.05, 20.0), diff_step=1e-4, x_scale="jac")
    fitted = dict(zip(FREE, (solved.x * scale).tolist(), strict=True))
    return SciPyFit({**p, **fitted}, float(2 * solved.cost), runs)
