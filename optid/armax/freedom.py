"""Degrees of freedom of an estimated variance of A's and B's coefficients.

A standard error is computed with the noise's spectrum, C and a variance, which come from the same data. Where C is
slow, as with sensor noise (C = A), few effective samples determine it, and an interval of 1.96 standard errors is too
short. The degrees of freedom are Satterthwaite's, two over the relative variance of the variance, C and the noise's
variance being what varies (Kenward and Roger, Biometrics 53, 1997).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from optid.armax.batch import STABLE_RADIUS, equilibrated
from optid.armax.gradient import Problem
from optid.armax.stability import roots_inside
from optid.core.model import Array

FEWEST = 5.0  # smaller results extrapolate the change of the variance with C
STEP = 0.05  # standard errors by which a coefficient of C is moved for the slope of the variance


@dataclass(frozen=True, eq=False)
class VarianceSlopes:
    """Inverse of the information with each of C's coefficients moved down and up.

    Attributes:
        moved: by coefficient, (down, up), each of shape (n, n).
        steps: between down and up, shape (nc,).
        spread: covariance of C's coefficients, shape (nc, nc).
        left: residuals less parameters.
    """

    moved: tuple[tuple[Array, Array], ...]
    steps: Array
    spread: Array
    left: int

    @classmethod
    def at(cls, problem: Problem, theta: Array, loss: float) -> VarianceSlopes:
        """Around a problem's best parameters and their loss; 2 nc passes through the recordings."""
        left = max(problem.count - theta.size, 1)
        block = np.arange(theta.size)[problem.orders.c_block]
        spread = loss * problem.count / left * _inverse(problem, theta)[np.ix_(block, block)]
        steps, moved = np.zeros(block.size), []
        for i, k in enumerate(block):
            pair = []
            for side in (-1.0, 1.0):
                there = theta.copy()
                there[k] += side * STEP * np.sqrt(spread[i, i])
                if not _stable(problem, there):
                    there = theta
                steps[i] += abs(there[k] - theta[k])
                pair.append(_inverse(problem, there))
            moved.append((pair[0], pair[1]))
        return cls(tuple(moved), steps, spread, left)

    def freedom(self, row: Array) -> float:
        """Of the variance of row' theta."""
        logs = np.array([[np.log(row @ V @ row) for V in pair] for pair in self.moved]).reshape(-1, 2)
        slopes = (logs[:, 1] - logs[:, 0]) / np.where(self.steps > 0.0, self.steps, np.inf)
        found = 2.0 / (float(slopes @ self.spread @ slopes) + 2.0 / self.left)
        return max(found, min(FEWEST, self.left)) if found == found else FEWEST

    def quantile(self, row: Array) -> float:
        """Standard errors of row' theta at a 95 % interval's end."""
        from scipy.special import stdtrit

        return float(stdtrit(self.freedom(row), 0.975))


def _inverse(problem: Problem, theta: Array) -> Array:
    R, _, size = equilibrated(problem.information(theta))
    return np.asarray(np.linalg.inv(R.T @ R + 1e-12 * np.eye(size.size)) / np.outer(size, size))


def _stable(problem: Problem, theta: Array) -> bool:
    orders = problem.orders
    return bool(roots_inside(theta[orders.c_block], orders.nc, STABLE_RADIUS, np.empty(2 * orders.nc)))
