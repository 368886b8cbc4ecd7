"""Baseline: a small neural residual in eq. 11; it predicts and names nothing.

The base model is fitted first. A network of one hidden layer learns the missing force (see equation.py) from
position, speed and the pressures' difference, and stands in the model as a force of its own. It learns from all
recordings but the last, which tells how hard its weights are pulled to zero, and whether it is better left out.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from scipy.optimize import least_squares

sys.path.insert(0, str(Path(__file__).parents[2]))  # finds the studies beside it from any folder

from optid.core.model import Array
from optid.core.sheet import Sheet
from optid.effects.effect import Effect
from optid.estimation.multiple_shooting import FitOptions, fit
from optid.estimation.result import Fit
from optid.rigs.rigfile import Rig, with_effects
from studies.baselines.equation import motion_of
from studies.baselines.task import Said, Task, asked, deliver, finding, parameters, window_rmse

HIDDEN = 8
SCALES = (0.1, 0.3, 1e5)  # of the inputs: m, m/s, Pa
FORCE = 50.0  # N, of the output
THIN = 10
DECAYS = (0.3, 1.0, 3.0, 10.0)  # pull of the weights to zero, in units of the residual's standard deviation
WORTH = 0.2  # a force of which more of the RMSE falls than this is called unexplained


@dataclass(frozen=True, eq=False)
class Network:
    """A layer of tanh: inputs (n, 3) scaled -> force, N; `weights` is (HIDDEN, 5)."""

    weights: Array

    def __call__(self, inputs: Array) -> Array:
        """The force, (n,)."""
        w = self.weights
        return np.asarray(FORCE * np.tanh(inputs @ w[:, :3].T + w[:, 3]) @ w[:, 4])

    def slopes(self, inputs: Array) -> Array:
        """Of the force by the weights, (n, HIDDEN * 5)."""
        w = self.weights
        bent = np.tanh(inputs @ w[:, :3].T + w[:, 3])
        by_sum = w[:, 4] * (1.0 - bent**2)
        parts = [*(by_sum * inputs[:, [k]] for k in range(3)), by_sum, bent]
        return np.asarray(FORCE * np.stack(parts, axis=2).reshape(len(inputs), -1))


class NeuralForce(Effect):
    """The network as a force on the piston; it has no parameters that a fit could move."""

    name = "neural_force"
    sites = ("force.friction",)
    parameters = ()

    def __init__(self, network: Network) -> None:
        self.network = network

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """Friction less the network's force, N."""
        inputs = [near["x"] / SCALES[0], near["v"] / SCALES[1], (near["P_a"] - near["P_b"]) / SCALES[2]]
        total = nominal
        for w in self.network.weights:
            total -= FORCE * w[4] * ca.tanh(sum(w[k] * inputs[k] for k in range(3)) + w[3])
        return total


def learned(inputs: Array, force: Array, decay: float, rng: np.random.Generator) -> Network:
    """The network that fits best, with weight decay, from random weights."""
    start = 0.5 * rng.normal(size=HIDDEN * 5)
    spread = max(float(np.std(force)), 1.0)

    def residual(theta: Array) -> Array:
        off = (Network(theta.reshape(HIDDEN, 5))(inputs) - force) / spread
        return np.concatenate([off, decay * theta])

    def slopes(theta: Array) -> Array:
        return np.concatenate(
            [Network(theta.reshape(HIDDEN, 5)).slopes(inputs) / spread, decay * np.eye(len(theta))]
        )

    found = least_squares(residual, start, jac=slopes, method="lm", max_nfev=200)
    return Network(np.asarray(found.x).reshape(HIDDEN, 5))


def chosen(task: Task, base: Fit) -> Rig:
    """The rig with the network whose decay predicts the last recording best, or without one if that does."""
    *seen, last = task.train
    motions = [motion_of(recording, base.values) for recording in seen]
    inputs = np.concatenate(
        [np.stack([m.x, m.v, m.P_a - m.P_b], axis=1)[m.slides][::THIN] / SCALES for m in motions]
    )
    force = np.concatenate([m.force[m.slides][::THIN] for m in motions])
    networks = [learned(inputs, force, decay, np.random.default_rng(0)) for decay in DECAYS]
    rigs = [task.rig, *(with_effects(task.rig, (NeuralForce(network),)) for network in networks)]
    return min(rigs, key=lambda rig: window_rmse(rig, last, base))


def main() -> None:
    """Answer the task."""
    task = asked()
    base = fit(task.rig, task.train, FitOptions(time_limit=300.0))
    before = window_rmse(task.rig, task.holdout, base)
    after = window_rmse(chosen(task, base), task.holdout, base)
    lacks = after < (1.0 - WORTH) * before
    findings = (finding(None, "force"),) if lacks else ()
    deliver(task, Said("unexplained" if lacks else "consistent", findings, parameters(base), before, after))


if __name__ == "__main__":
    main()
