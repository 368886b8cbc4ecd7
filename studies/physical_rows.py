"""The fitted physical model at Table 2's horizons: an extended Kalman filter over the rig's own equations.

Predicting k steps ahead asks a physical model for a state from measurements up to t - k; the filter gives it, with the
equations of optid's plant in the smooth reading of dry friction, parameters fitted to the part in sample, and the
process noise that predicts that part best one step ahead.
"""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from optid.core.readers import read_recording
from optid.estimation.multiple_shooting import FitOptions, fit
from optid.rigs.rigfile import Rig, read_rig

Array = NDArray[np.float64]
ROOT = Path(__file__).parents[1]
STEPS = (1, 5, 10)
SUBSTEPS = 4
NOISE = 3e-5  # m, of the position's sensor
SHARES = (1e-4, 1e-3, 1e-2)  # process noise a sample, of each state's usual size
FIT_NOISE = 1e-3  # share of each state's size that it may jump in the fit; the filter chooses its own
HELD_OUT = 0.3


def physical_entries(
    y: Array, u: Array, sample_time: float, folder: Path | None = None
) -> dict[str, dict[int, float]]:
    """Standard deviation of the k-step errors, in the unit of y (cm), by part and horizon.

    Args:
        y: position, cm; u: command, V.
        sample_time: seconds.
        folder: for the files that the fit reads.
    """
    import tempfile

    with tempfile.TemporaryDirectory() as made:
        rig, p = fitted(folder or Path(made), y, u, sample_time)
    full = rig.channels["command"].full_scale or 1.0
    position, command, cut = 1e-2 * y, u / full, round(y.size * (1 - HELD_OUT))
    step = stepper(rig, p, sample_time)
    tried = [filtered(step, rig, p, position, command, share) for share in SHARES]
    best = min(tried, key=lambda means: float(np.std((ahead(step, means, command, 1) - position)[50:cut])))
    out: dict[str, dict[int, float]] = {"in sample": {}, "held out": {}}
    for k in STEPS:
        error = 100 * (ahead(step, best, command, k) - position)
        out["in sample"][k] = float(np.nanstd(error[50:cut]))
        out["held out"][k] = float(np.nanstd(error[cut:]))
    return out


def fitted(folder: Path, y: Array, u: Array, sample_time: float) -> tuple[Rig, Array]:
    """The bench's rig file with smooth friction, fitted to the first part."""
    cut = round(y.size * (1 - HELD_OUT))
    rows = np.column_stack([sample_time * np.arange(cut), u[:cut], 10 * y[:cut]])
    np.savetxt(folder / "part.csv", rows, delimiter=",", header="t,u,x", comments="", fmt="%.7g")
    text = (ROOT / "data" / "bench.toml").read_text(encoding="utf-8")
    text = text.replace("[parameters]", '[options]\nfriction = "smooth"\n\n[parameters]')
    left_out = (
        "reference = ",
        "residual_length = {",
    )  # pulses that keep off the ends do not tell the residual length
    text = "\n".join(line for line in text.splitlines() if not line.startswith(left_out))
    (folder / "rig.toml").write_text(text, encoding="utf-8")
    rig = read_rig(folder / "rig.toml")
    found = fit(rig, [read_recording(folder / "part.csv", rig)], FitOptions(process_noise=FIT_NOISE))
    return rig, rig.model.vector(dict(found.values))


def stepper(rig: Rig, p: Array, sample_time: float) -> ca.Function:
    """(x, u) -> next state and its slope, by Runge-Kutta steps."""
    model = rig.model
    x, u = ca.SX.sym("x", len(model.states)), ca.SX.sym("u", len(model.inputs))
    h, state = sample_time / SUBSTEPS, x
    for _ in range(SUBSTEPS):
        a = model.rates(state, u, p)
        b = model.rates(state + h / 2 * a, u, p)
        c = model.rates(state + h / 2 * b, u, p)
        d = model.rates(state + h * c, u, p)
        state = state + h / 6 * (a + 2 * b + 2 * c + d)
    return ca.Function("step", [x, u], [state, ca.jacobian(state, x)])


def filtered(step: ca.Function, rig: Rig, p: Array, y: Array, u: Array, share: float) -> Array:
    """Means after each sample's measurement, shape (N, states)."""
    model = rig.model
    x = np.array(model.start(p)[0]).ravel()
    names = [state.name for state in model.states]
    at = names.index("position")
    x[at] = y[0]
    C = np.zeros((1, x.size))
    C[0, at] = 1.0
    P, Q = np.diag((0.1 * model.scales) ** 2), np.diag((share * model.scales) ** 2)
    Q[at, at] = 0.0
    means = np.empty((y.size, x.size))
    for t in range(y.size):
        if t:
            moved, slope = step(x, u[t - 1])
            A = np.array(slope)
            x, P = np.array(moved).ravel(), A @ P @ A.T + Q
        S = float((C @ P @ C.T).item()) + NOISE**2
        K = (P @ C.T / S).ravel()
        x = x + K * (y[t] - x[at])
        P = P - np.outer(K, C @ P)
        means[t] = x
    return means


def ahead(step: ca.Function, means: Array, u: Array, k: int) -> Array:
    """Position predicted k samples ahead of every sample's mean, shape (N,), NaN at the first k."""
    many = step.map(means.shape[0])
    states = means.T.copy()
    for j in range(k):
        command = np.concatenate([u[j:], np.full(j, u[-1])])
        states = np.array(many(states, command[None, :])[0])
    out = np.full(means.shape[0], np.nan)
    out[k:] = states[0, :-k]
    return out
