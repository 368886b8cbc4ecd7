"""Baseline: sparse regression of the equation residual, as in SINDy discrepancy models.

The base model is fitted first. What eq. 11 then lacks (see equation.py) is regressed on a library of terms, each of
which stands for an effect; terms are dropped one by one while BIC falls. The largest that is left is named. Effects
that are no term of eq. 11 cannot be named by it.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))  # finds the studies beside it from any folder

from optid.core.model import Array
from optid.estimation.multiple_shooting import FitOptions, fit
from optid.estimation.result import Fit
from studies.baselines.equation import Motion, motion_of
from studies.baselines.task import Said, Task, asked, deliver, finding, parameters, window_rmse

REFIT = ("viscous", "coulomb")  # what the base model may take for itself
THIN = 25  # samples; nearer ones hold the same noise
WORTH = 0.02  # of the residual's energy that a named term must explain


def library(m: Motion) -> dict[str, Array]:
    """Terms by the effect that each stands for; "effect.n" when an effect has several."""
    way = np.sign(m.v)
    return {
        "viscous": m.v,
        "coulomb": way,
        "constant_force": np.ones_like(m.v),
        "spring_load": m.x,
        "quadratic_drag": m.v * np.abs(m.v),
        "stribeck_friction.1": way * np.exp(-np.abs(m.v) / 0.01),
        "stribeck_friction.2": way * np.exp(-np.abs(m.v) / 0.04),
        "position_dependent_friction.1": way * m.x,
        "position_dependent_friction.2": way * m.x**2,
        "friction_drift": way * m.t,
        "compliant_load": m.a,
        "asymmetric_friction": np.abs(m.v),
    }


def selected(y: Array, X: Array, keep: list[int]) -> tuple[list[int], Array]:
    """Columns left, and their coefficients, when none can go without BIC rising; those in `keep` stay."""
    n, chosen = len(y), list(range(X.shape[1]))

    def fitted(columns: list[int]) -> tuple[float, Array]:
        theta = np.linalg.lstsq(X[:, columns], y, rcond=None)[0]
        variance = float(np.mean((y - X[:, columns] @ theta) ** 2))
        return n * np.log(variance) + np.log(n) * len(columns), theta

    score, theta = fitted(chosen)
    while len(chosen) > len(keep):
        trials = [(fitted([c for c in chosen if c != drop])[0], drop) for drop in chosen if drop not in keep]
        least, drop = min(trials)
        if least > score:
            break
        chosen.remove(drop)
        score, theta = fitted(chosen)
    return chosen, theta


def named(task: Task, base: Fit) -> str | None:
    """The effect whose terms explain most of the residual; None if none explains what is worth a name."""
    motions = [motion_of(recording, base.values) for recording in task.train]
    names = list(library(motions[0]))
    rows = [np.flatnonzero(m.slides)[::THIN] for m in motions]
    X = np.concatenate(
        [np.stack(list(library(m).values()), axis=1)[r] for m, r in zip(motions, rows, strict=True)]
    )
    y = np.concatenate([m.force[r] for m, r in zip(motions, rows, strict=True)])
    X = X / np.linalg.norm(X, axis=0)
    base_terms = [names.index(name) for name in REFIT]
    chosen, theta = selected(y, X, base_terms)
    shares: dict[str, float] = {}
    for effect in {names[c].partition(".")[0] for c in chosen} - set(REFIT):
        rest = [c for c in range(len(chosen)) if names[chosen[c]].partition(".")[0] != effect]
        columns = X[:, [chosen[c] for c in rest]]
        without = y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]
        full = y - X[:, chosen] @ theta
        shares[effect] = float((without @ without - full @ full) / (y @ y))
    best = max(shares, key=lambda name: shares[name], default=None)
    return best if best is not None and shares[best] > WORTH else None


def main() -> None:
    """Answer the task."""
    task = asked()
    base = fit(task.rig, task.train, FitOptions(time_limit=300.0))
    rmse = window_rmse(task.rig, task.holdout, base)
    effect = named(task, base)
    findings = () if effect is None else (finding(effect, "force"),)
    deliver(task, Said("missing-physics" if effect else "consistent", findings, parameters(base), rmse, rmse))


if __name__ == "__main__":
    main()
