"""CasADi and IPOPT as CasADi's own example of system identification has it (`docs/examples/python/sysid.py`).

Multiple shooting: the states at all samples are unknowns beside the parameters, a Runge-Kutta step of every sample is
tied to the next one, and IPOPT gets the Gauss-Newton Hessian of the squared errors. The equations are optid's, by
`Model.to_casadi`, so that this compares the route and not the model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from optid.core.model import Array
from optid.rigs.rigfile import Rig

SUBSTEPS = 2  # Runge-Kutta steps a sample, as the other routes


@dataclass(frozen=True)
class CasadiFit:
    """Fitted parameters (SI), IPOPT's word on how it ended, and its iterations."""

    parameters: dict[str, float]
    outcome: str
    iterations: int


def fit(rig: Rig, start: Sequence[float], commands: Array, positions: Array, dt: float) -> CasadiFit:
    """Fit the rig's free parameters from the values in its file.

    Args:
        rig: model, start values and bounds.
        start: states at the first sample, SI.
        commands: held commands as shares of full scale, shape (n,).
        positions: measured positions, m, shape (n,).
        dt: sample time, s.
    """
    model, n = rig.model, len(commands)
    f = model.to_casadi(SUBSTEPS)
    given, scales = f.values(rig.parameters), model.scales
    free = [model.index(one.name) for one in rig.freed]
    size = given[free]
    step = _scaled_step(f.step, given, free, scales, dt)
    theta, X = ca.MX.sym("theta", len(free)), ca.MX.sym("X", len(scales), n)
    ends = step.map(n - 1)(X[:, :-1], commands[:-1].reshape(1, -1), ca.repmat(theta, 1, n - 1))
    gaps = ca.vertcat(ca.vec(ends - X[:, 1:]), X[:, 0] - np.asarray(start) / scales)
    place = list(f.states).index("position")
    error = (X[place, :].T * scales[place] - positions) / np.std(np.diff(positions))
    unknown = ca.veccat(theta, X)
    problem = {"x": unknown, "f": 0.5 * ca.dot(error, error), "g": gaps}
    options = {
        "ipopt.print_level": 0,
        "print_time": False,
        "hess_lag": _gauss_newton(error, problem, unknown),
    }
    solver = ca.nlpsol("solver", "ipopt", problem, options)
    guess = np.tile(np.asarray(start) / scales, (n, 1))
    guess[:, place] = positions / scales[place]
    low, high = (np.array([getattr(one, end) for one in rig.freed]) / size for end in ("low", "high"))
    unbounded = np.full(guess.size, np.inf)
    found = solver(
        x0=np.r_[np.ones(len(free)), guess.ravel()],
        lbx=np.r_[low, -unbounded],
        ubx=np.r_[high, unbounded],
        lbg=0.0,
        ubg=0.0,
    )
    values = np.array(found["x"]).ravel()[: len(free)] * size
    said = solver.stats()
    names = [one.name for one in rig.freed]
    return CasadiFit(
        dict(zip(names, values.tolist(), strict=True)), said["return_status"], said["iter_count"]
    )


def _scaled_step(
    step: ca.Function, given: Array, free: Sequence[int], scales: Array, dt: float
) -> ca.Function:
    """(x / scales, u, theta as shares of the start values) -> the next x / scales."""
    x, u, theta = ca.SX.sym("x", len(scales)), ca.SX.sym("u"), ca.SX.sym("theta", len(free))
    p = ca.SX(ca.DM(given))
    for k, place in enumerate(free):
        p[place] = theta[k] * given[place]
    return ca.Function("scaled", [x, u, theta], [step(x * scales, u, p, dt) / scales])


def _gauss_newton(error: ca.MX, problem: dict[str, ca.MX], unknown: ca.MX) -> ca.Function:
    slope = ca.jacobian(error, unknown)
    weight = ca.MX.sym("weight")
    return ca.Function(
        "nlp_hess_l",
        {"x": unknown, "lam_f": weight, "hess_gamma_x_x": weight * ca.triu(ca.mtimes(slope.T, slope))},
        ["x", "p", "lam_f", "lam_g"],
        ["hess_gamma_x_x"],
    )
