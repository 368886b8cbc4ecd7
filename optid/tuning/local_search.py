"""Local optimisation after the global search: sequential quadratic programming with exact gradients."""

from __future__ import annotations

from typing import Any

import numpy as np

from optid.core.model import Array
from optid.tuning.gradient import Gradient
from optid.tuning.nyquist import DELAY, GAIN, MS, PHASE
from optid.tuning.search import GainBounds
from optid.tuning.task import REFUSED, Task

STEPS = 60  # of the quadratic programming
SIDE = 1e-6  # of the unit cube: the step of the margins' own finite differences
SIMPLEX = 200  # evaluations of a simplex search
ROUNDS, GAIN_OF_A_ROUND = 3, 2e-4  # rounds of both, and the relative gain required for a further one


def polish(task: Task, within: GainBounds, point: Array, gradient: Gradient | None) -> Array:
    """The best point found from `point` (free,); never a worse one.

    Args:
        task: its cost is minimised.
        within: the box; the search moves in the unit cube.
        point: start, which meets the requirements.
        gradient: None takes a simplex search, as for a cost without a known gradient.
    """

    def fitness(one: Array) -> float:
        return float(task.fitness(within.gains(np.clip(one, 0.0, 1.0)))[0])

    best, value = point, fitness(point)
    if value >= REFUSED:
        return point
    for _ in range(ROUNDS):
        before = value
        for search in (_quadratic, _simplex) if gradient else (_simplex,):
            end = search(task, within, best, gradient)
            found = fitness(end)
            if found < value:
                best, value = end, found
        if value > before * (1.0 - GAIN_OF_A_ROUND):
            break
    return best


def _quadratic(task: Task, within: GainBounds, point: Array, gradient: Gradient | None) -> Array:
    from scipy import optimize

    assert gradient is not None
    evaluate, begin = gradient, float(task.fitness(within.gains(point))[0])
    seen: list[tuple[float, Array]] = []

    def cost(one: Array) -> Any:
        value, slope = evaluate(within.gains(one)[0])
        if not (np.isfinite(value) and np.all(np.isfinite(slope))):
            return 1e3, np.zeros(len(one))
        return value / begin, slope * within.slopes(one) / begin

    wanted = _slack(task, within)
    constraints: Any = () if wanted is None else ({"type": "ineq", "fun": wanted, "jac": _sided(wanted)},)

    def keep(one: Array) -> None:
        here = np.clip(one, 0.0, 1.0)
        seen.append((float(task.fitness(within.gains(here))[0]), here.copy()))

    keep(point)
    minimize: Any = optimize.minimize  # its stubs do not have functions that also return the gradient
    found = minimize(
        cost,
        point,
        jac=True,
        method="SLSQP",
        bounds=[(0.0, 1.0)] * len(within.free),
        constraints=constraints,
        callback=keep,
        options={"maxiter": STEPS, "ftol": 1e-9},
    )
    keep(found.x)
    return min(seen, key=lambda one: one[0])[1]


def _slack(task: Task, within: GainBounds) -> Any:
    """Relative slack of each required margin, on every plant; None without requirements."""
    bounds = task.bounds
    asked = [field for field in (MS, GAIN, PHASE, DELAY) if 0.0 < bounds[field] < np.inf]
    if not asked:
        return None

    def slack(one: Array) -> Array:
        found = task.margins(within.gains(np.clip(one, 0.0, 1.0))[0])
        room = [
            (1.0 - row[field] / bounds[field])
            if field == MS
            else (min(row[field], 1e6) / bounds[field] - 1.0)
            for row in found
            for field in asked
        ]
        return np.array(room)

    return slack


def _sided(function: Any) -> Any:
    """Central differences of margins, which are smooth except where another frequency becomes critical."""

    def jacobian(one: Array) -> Array:
        columns = [
            (function(one + step) - function(one - step)) / (2 * SIDE) for step in SIDE * np.eye(len(one))
        ]
        return np.array(columns).T

    return jacobian


def _simplex(task: Task, within: GainBounds, point: Array, _: Gradient | None) -> Array:
    """Simplex search without derivatives, across the kinks of a cost due to absolute values and limits."""
    from scipy.optimize import minimize

    def fitness(one: Array) -> float:
        return float(task.fitness(within.gains(np.clip(one, 0.0, 1.0)))[0])

    start = np.vstack([point, point + 0.02 * np.where(point < 0.5, 1.0, -1.0) * np.eye(len(point))])
    found = minimize(
        fitness,
        point,
        method="Nelder-Mead",
        options={"maxfev": SIMPLEX, "initial_simplex": start, "xatol": 1e-5, "fatol": 1e-12},
    )
    return np.clip(found.x, 0.0, 1.0)
