"""A linearly implicit step of a model, as one symbolic function; friction at rest does not limit its length.

The bristles of an axis at rest relax and oscillate within tens of microseconds, at amplitudes that nothing measures.
An explicit method has to follow them; this one damps what it does not resolve.

RODAS3 (Sandu and others, Atmospheric Environment 31, 1997, p. 3459): four stages of order 3 with an embedded method of
order 2, both L-stable, in the form without products with the Jacobian (Hairer and Wanner, Solving Ordinary Differential
Equations II, section IV.7). Commands are held over a step, so the equations do not know the time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca

from optid.core.model import Model

GAMMA = 0.5
A = ((), (0.0,), (2.0, 0.0), (2.0, 0.0, 1.0))  # of the stages in each other's state
C = ((), (4.0,), (1.0, -1.0), (1.0, -1.0, -8.0 / 3.0))  # of the stages in each other's slope, over h
M = (2.0, 0.0, 1.0, 1.0)  # the step of order 3; the step of order 2 lacks the last stage


def symbols(model: Model) -> list[ca.SX]:
    """x, u, p, the length of a step, and the half of a hold that it lies in."""
    sizes = {"x": len(model.states), "u": len(model.inputs), "p": len(model.parameters), "h": 1, "half": 1}
    return [ca.SX.sym(name, size) for name, size in sizes.items()]


def moved(model: Model, x: ca.SX, u: ca.SX, p: ca.SX, _: ca.SX, half: ca.SX) -> ca.SX:
    """dx/dt as the integrator goes: halves of a hold that is not the same all along take equally long."""
    return ca.densify(model.rates(x, u, p) if model.halves is None else model.halves(x, u, p, half))


def rosenbrock(model: Model) -> ca.Function:
    """(x, u, p, h, half) -> the states after h seconds, and below them what the step of order 2 leaves out; SI."""
    x, u, p, h, half = symbols(model)
    rates = moved(model, x, u, p, h, half)
    solved = _factorised(ca.SX.eye(x.numel()) / (GAMMA * h) - ca.jacobian(rates, x))
    stages: list[ca.SX] = []
    for a, c in zip(A, C, strict=True):
        slope = ca.substitute(rates, x, _combined(x, a, stages)) if any(a) else rates
        stages.append(solved(_combined(slope, [weight / h for weight in c], stages)))
    return ca.Function("step", [x, u, p, h, half], [ca.cse(ca.vertcat(_combined(x, M, stages), stages[-1]))])


def _combined(start: ca.SX, weights: Sequence[float | ca.SX], terms: Sequence[ca.SX]) -> ca.SX:
    for weight, term in zip(weights, terms, strict=True):
        if isinstance(weight, ca.SX) or weight:
            start = start + weight * term
    return start


def _factorised(W: ca.SX) -> Callable[[ca.SX], ca.SX]:
    """What solves W y = b, by Gauss' elimination with as few terms as W's zeros allow.

    Pivots are taken on the diagonal, which is 1/(h/2) and what states relax by.
    """
    left = set(range(W.size1()))
    entry = {(i, j): W[i, j] for i, j in zip(*W.sparsity().get_triplet(), strict=True)}
    lower: list[tuple[int, list[tuple[int, ca.SX]]]] = []
    upper: list[tuple[int, ca.SX, list[tuple[int, ca.SX]]]] = []
    while left:
        pivot = min(left, key=lambda i: (_neighbours(entry, left, i), i))
        left.remove(pivot)
        inverse = 1.0 / entry[pivot, pivot]
        right = [(j, entry[pivot, j]) for j in sorted(left) if (pivot, j) in entry]
        below = [(i, entry[i, pivot] * inverse) for i in sorted(left) if (i, pivot) in entry]
        for i, factor in below:
            for j, value in right:
                entry[i, j] = entry.get((i, j), ca.SX(0)) - factor * value
        lower.append((pivot, below))
        upper.append((pivot, inverse, right))

    def solve(b: ca.SX) -> ca.SX:
        y = ca.vertsplit(b)
        for pivot, below in lower:
            for i, factor in below:
                y[i] = y[i] - factor * y[pivot]
        for pivot, inverse, right in reversed(upper):
            for j, value in right:
                y[pivot] = y[pivot] - value * y[j]
            y[pivot] = y[pivot] * inverse
        return ca.vertcat(*y)

    return solve


def _neighbours(entry: dict[tuple[int, int], ca.SX], left: set[int], i: int) -> int:
    """Entries that eliminating row i touches (Markowitz's count)."""
    return sum((i, j) in entry for j in left - {i}) * sum((j, i) in entry for j in left - {i})
