"""CasADi and IPOPT for gains: the loop unrolled by `mapaccum`, its ITAE minimised over the gains by `nlpsol`.

Single shooting, as CasADi's own example has it (`docs/examples/python/direct_single_shooting.py`): the gains are the
only unknowns. Limits and the integrator's stop are `fmin`, `fmax` and `if_else`, so IPOPT gets derivatives with jumps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from optid.core.model import Array


@dataclass(frozen=True)
class CasadiGains:
    """Gains (kp, ki, kd), their cost, IPOPT's word on how it ended, and its iterations."""

    gains: tuple[float, float, float]
    cost: float
    outcome: str
    iterations: int


def tune(
    a: Sequence[float],
    b: Sequence[float],
    start: Array,
    lag: float,
    *,
    samples: int,
    sample_time: float,
    size: float,
    limit: float,
) -> CasadiGains:
    """Least ITAE of a step over kp, ki and kd.

    Args:
        a: coefficients of the model's denominator after the leading one.
        b: of its numerator, from one delay on, as many.
        start: gains to begin with; also their scale.
        lag: time constant of the derivative, s.
        samples: of the run.
        sample_time: s.
        size: of the step.
        limit: of the command, both ways.
    """
    theta = ca.MX.sym("theta", 3)
    loop = _loop(a, b, lag, sample_time, size, limit, np.asarray(start)).mapaccum(samples)
    _, errors = loop(np.zeros(len(a) + 3), ca.repmat(theta, 1, samples))
    weight = sample_time * sample_time * np.arange(samples)
    scale = size * float(weight.sum())
    problem = {"x": theta, "f": ca.dot(weight, ca.fabs(errors).T) / scale}
    options = {
        "ipopt.print_level": 0,
        "print_time": False,
        "ipopt.hessian_approximation": "limited-memory",  # second derivatives of 2000 samples take minutes to build
        "ipopt.max_iter": 200,
    }
    solver = ca.nlpsol("solver", "ipopt", problem, options)
    found = solver(x0=np.ones(3), lbx=np.zeros(3), ubx=np.full(3, 100.0))
    said = solver.stats()
    kp, ki, kd = (np.array(found["x"]).ravel() * start).tolist()
    return CasadiGains((kp, ki, kd), float(found["f"]) * scale, said["return_status"], said["iter_count"])


def _loop(
    a: Sequence[float], b: Sequence[float], lag: float, T: float, size: float, limit: float, start: Array
) -> ca.Function:
    """(states, gains as shares of the start) -> states a sample later, and the error."""
    order = len(a)
    x, theta = ca.SX.sym("x", order + 3), ca.SX.sym("theta", 3)
    z, integral, slope, last = x[:order], x[order], x[order + 1], x[order + 2]
    kp, ki, kd = (theta[i] * float(start[i]) for i in range(3))
    y = z[0]
    e = size - y
    slope = (lag * slope - (y - last)) / (lag + T)
    grown = ki * T * e
    wish = kp * e + integral + grown + kd * slope
    u = ca.fmin(ca.fmax(wish, -limit), limit)
    integral += ca.if_else((wish - u) * grown <= 0.0, grown, 0.0)
    ahead = ca.vertcat(z[1:], 0.0)
    z = ahead + ca.DM(list(b)) * u - ca.DM(list(a)) * y
    return ca.Function("loop", [x, theta], [ca.vertcat(z, integral, slope, y), e])
