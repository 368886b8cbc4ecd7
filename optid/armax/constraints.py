"""Linear constraints on an ARMAX model's coefficients for a given static gain or a given pole.

A constraint says, at coefficients theta and the angle of a pair of poles: rows L and right side d of L theta = d, and
the change of L theta - d with the angle.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from optid.armax.structure import Orders
from optid.core.model import Array

Constraint = Callable[[Array, float], tuple[Array, Array, Array]]


def fixed_gain(orders: Orders, input: int, value: float) -> Constraint:
    """B(1) = value A(1) for one of the inputs."""
    row = np.zeros(orders.parameters)
    row[: orders.na], row[list(orders.blocks())[input]] = -value, 1.0
    return lambda theta, angle: (row[None, :], np.array([value]), np.zeros(1))


def fixed_pole(orders: Orders, x: float) -> Constraint:
    """A(x) = 0."""
    n, row = orders.na, np.zeros(orders.parameters)
    row[:n] = x ** np.arange(n - 1.0, -1.0, -1.0)
    return lambda theta, angle: (row[None, :], np.array([-(x**n)]), np.zeros(1))


def fixed_pair(orders: Orders, modulus: float) -> Constraint:
    """A = 0 at a pair of poles of this modulus and of any angle."""
    n = orders.na
    powers = np.arange(n, -1.0, -1.0)

    def rows(theta: Array, angle: float) -> tuple[Array, Array, Array]:
        """Re A(z) and Im A(z) / sin(angle), which stays regular where the pair becomes a double pole."""
        of, slope = np.zeros((2, n + 1)), np.zeros((2, n + 1))
        size, s, c = modulus**powers, math.sin(angle), math.cos(angle)
        of[0], of[1] = size * np.cos(powers * angle), size * np.sin(powers * angle) / s
        slope[0] = -powers * size * np.sin(powers * angle)
        slope[1] = (powers * size * np.cos(powers * angle) - of[1] * c) / s
        full, turned = np.zeros((2, theta.size)), np.zeros((2, theta.size))
        full[:, :n], turned[:, :n] = of[:, 1:], slope[:, 1:]
        return full, -of[:, 0], slope[:, 0] + turned @ theta

    return rows


def across(constraint: Constraint, theta: Array, angle: float) -> Array:
    """The direction of the coefficients, shape (n,), normal to the constraint for any change of the angle."""
    rows, _, turn = constraint(theta, angle)
    return np.asarray(rows[0] if len(rows) == 1 else turn[1] * rows[0] - turn[0] * rows[1])
