"""The fitted physical model at Table 2's horizons: an extended Kalman filter over the rig's own equations.

Predicting k steps ahead asks a physical model for a state from measurements up to t - k; the filter gives it, with the
equations of optid's plant in the smooth reading of dry friction, the discharge coefficient and the frictions fitted to
the part in sample by one-step prediction errors, and the process noise that predicts that part best one step ahead.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from optid.rigs.rigfile import Rig, read_rig

Array = NDArray[np.float64]
ROOT = Path(__file__).parents[1]
STEPS = (1, 5, 10)
SUBSTEPS = 4  # with 2, Runge-Kutta is at the edge of stability where smooth friction is steepest
NOISE = 3e-5  # m, of the position's sensor
SHARES = (1e-3, 3e-3, 1e-2, 3e-2, 1e-1)  # process noise a sample, of each state's usual size
FREE = ("discharge_coefficient", "viscous_friction", "coulomb_friction")
REST = 250  # samples, of the first pulse, in which the filter finds the pressures
MOST_LOOKS = 12
HELD_OUT = 0.3


def physical_entries(y: Array, u: Array, sample_time: float) -> dict[str, dict[int, float]]:
    """Standard deviation of the k-step errors, in the unit of y (cm), by part and horizon.

    Args:
        y: position, cm; u: command, V.
        sample_time: seconds.
    """
    rig = smooth_bench()
    command = u * rig.channels["command"].factor
    position, cut = 1e-2 * y, round(y.size * (1 - HELD_OUT))
    step = stepper(rig, sample_time)
    update = filter_step(rig, step)
    start = rig.model.vector(dict(rig.parameters))
    share = best_share(update, rig, start, position[:cut], command[:cut])
    p = fitted(update, rig, position[:cut], command[:cut], share)
    share = best_share(update, rig, p, position[:cut], command[:cut])
    best, _ = filtered(update, rig, p, position, command, share)
    out: dict[str, dict[int, float]] = {"in sample": {}, "held out": {}}
    for k in STEPS:
        error = 100 * (ahead(step, p, best, command, k) - position)
        out["in sample"][k] = float(np.nanstd(error[REST:cut]))
        out["held out"][k] = float(np.nanstd(error[cut:]))
    return out


def smooth_bench() -> Rig:
    """The bench's rig file with smooth friction."""
    text = (ROOT / "data" / "bench.toml").read_text(encoding="utf-8")
    text = text.replace("[parameters]", '[options]\nfriction = "smooth"\n\n[parameters]')
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rig.toml"
        path.write_text(text, encoding="utf-8")
        return read_rig(path)


def best_share(update: ca.Function, rig: Rig, p: Array, y: Array, u: Array) -> float:
    """Process noise with which the samples are predicted best one step ahead."""
    return min(SHARES, key=lambda share: float(np.std(filtered(update, rig, p, y, u, share)[1][REST:])))


def fitted(update: ca.Function, rig: Rig, y: Array, u: Array, share: float) -> Array:
    """Parameters with the smallest one-step prediction errors of the filter, the criterion of the ARMAX models."""

    def errors(values: Array) -> Array:
        p = rig.model.vector(dict(rig.parameters) | dict(zip(FREE, values, strict=True)))
        return filtered(update, rig, p, y, u, share)[1][REST:] / NOISE

    start = np.array([rig.parameters[name] for name in FREE])
    found = least_squares(
        errors, start, bounds=(0.3 * start, 3.0 * start), x_scale=start, diff_step=1e-3, max_nfev=MOST_LOOKS
    )
    return rig.model.vector(dict(rig.parameters) | dict(zip(FREE, found.x, strict=True)))


def stepper(rig: Rig, sample_time: float) -> ca.Function:
    """(x, u, p) -> next state, by Runge-Kutta steps."""
    model = rig.model
    x, u, p = (
        ca.SX.sym(n, len(of)) for n, of in (("x", model.states), ("u", model.inputs), ("p", model.parameters))
    )
    h, state = sample_time / SUBSTEPS, x
    for _ in range(SUBSTEPS):
        a = model.rates(state, u, p)
        b = model.rates(state + h / 2 * a, u, p)
        c = model.rates(state + h / 2 * b, u, p)
        d = model.rates(state + h * c, u, p)
        state = state + h / 6 * (a + 2 * b + 2 * c + d)
    return ca.Function("step", [x, u, p], [state])


def filter_step(rig: Rig, step: ca.Function) -> ca.Function:
    """(x and P before a measurement, y, u, p, Q) -> the same a sample later; x after the measurement, its error."""
    model, n = rig.model, len(rig.model.states)
    x, P, Q = ca.SX.sym("x", n), ca.SX.sym("P", n, n), ca.SX.sym("Q", n)
    y, u, p = ca.SX.sym("y"), ca.SX.sym("u", len(model.inputs)), ca.SX.sym("p", len(model.parameters))
    at = _position(rig)
    gain, error = P[:, at] / (P[at, at] + NOISE**2), y - x[at]
    mean, left = x + gain * error, P - gain @ P[at, :]
    state = ca.SX.sym("state", n)
    moved = step(state, u, p)
    slope = ca.substitute(ca.jacobian(moved, state), state, mean)
    both = ca.vertcat(ca.substitute(moved, state, mean), ca.vec(slope @ left @ slope.T + ca.diag(Q)))
    return ca.Function("update", [ca.vertcat(x, ca.vec(P)), y, u, p, Q], [both, ca.vertcat(mean, error)])


def filtered(
    update: ca.Function, rig: Rig, p: Array, y: Array, u: Array, share: float
) -> tuple[Array, Array]:
    """Means after each sample's measurement, shape (N, states), and the errors before it, shape (N,)."""
    model, at = rig.model, _position(rig)
    x, Q = np.array(model.start(p)[0]).ravel(), (share * model.scales) ** 2
    x[at], Q[at] = y[0], 0.0
    start = np.concatenate([x, np.diag((0.1 * model.scales) ** 2).ravel()])
    many = update.mapaccum(y.size)
    shared = (np.tile(each[:, None], y.size) for each in (p, Q))
    out = np.array(many(start, y[None, :], u[None, :], *shared)[1])
    return out[:-1].T, out[-1]


def _position(rig: Rig) -> int:
    return [state.name for state in rig.model.states].index("position")


def ahead(step: ca.Function, p: Array, means: Array, u: Array, k: int) -> Array:
    """Position predicted k samples ahead of every sample's mean, shape (N,), NaN at the first k."""
    many = step.map(means.shape[0])
    states = means.T.copy()
    for j in range(k):
        command = np.concatenate([u[j:], np.full(j, u[-1])])
        states = np.array(many(states, command[None, :], np.tile(p[:, None], means.shape[0])))
    out = np.full(means.shape[0], np.nan)
    out[k:] = states[0, :-k]
    return out
