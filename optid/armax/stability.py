"""Stability of C(q): the Schur-Cohn test, and scaling of the roots inwards."""

from __future__ import annotations

from optid.armax.compiling import inline_jit, jit
from optid.core.model import Array


@inline_jit
def roots_inside(c: Array, order: int, radius: float, work: Array) -> float:
    """1 if every root of z^order + c[0] z^(order-1) + ... lies inside the radius, else 0 (Schur and Cohn).

    Steps down from order to 0: each reflection coefficient must be smaller than 1.
    """
    total = 0.0
    bound = 1.0
    for i in range(order):
        total += abs(c[i])
        bound = bound * radius
    if total < bound and total < radius:  # Rouché: z^order outweighs the rest on the circle
        return 1.0
    factor = 1.0
    inverse = 1.0 / radius
    for i in range(order):
        factor = factor * inverse
        work[i] = c[i] * factor
    for down in range(order):
        k = order - down
        last = work[k - 1]
        if not abs(last) < 1.0:
            return 0.0
        inverse = 1.0 / (1.0 - last * last)
        for i in range(k - 1):
            work[order + i] = (work[i] - last * work[k - 2 - i]) * inverse
        for i in range(k - 1):
            work[i] = work[order + i]
    return 1.0


@jit
def stabilise(c: Array, order: int, radius: float, work: Array) -> float:
    """Scale the roots of C radially inwards until all lie inside the radius; returns 1 if that was needed."""
    if roots_inside(c, order, radius, work) > 0.0:
        return 0.0
    for _ in range(100):
        factor = 1.0
        for i in range(order):
            factor = factor * 0.95
            c[i] = c[i] * factor
        if roots_inside(c, order, radius, work) > 0.0:
            return 1.0
    for i in range(order):
        c[i] = 0.0
    return 1.0
