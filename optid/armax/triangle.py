"""The arithmetic of P = U D U' over padded arrays, in the small language that `optid.armax.translate` writes in C.

Bierman's update (Factorization Methods for Discrete Sequential Estimation, 1977, ch. V), written with
beta_j = 1 + w (f_1 v_1 + .. + f_j v_j) so that the weight w of a sample may be zero or, for directional
forgetting, negative. All arrays hold `size` numbers, a multiple of 4, U `size` columns of as many; behind the
parameters stand zeros, and ones on U's diagonal. Sums run in four lanes, as processors add vectors.

These functions say what happens; `optid.armax.vectors` does the same with vector instructions.
"""

from __future__ import annotations

from optid.core.model import Array

SMALLEST_VARIANCE = 1e-200  # of D: far below anything data can reach, far above underflow


def inner(x: Array, y: Array, size: int) -> float:
    """x' y."""
    a = 0.0
    b = 0.0
    c = 0.0
    d = 0.0
    for k in range(size // 4):
        a += x[4 * k] * y[4 * k]
        b += x[4 * k + 1] * y[4 * k + 1]
        c += x[4 * k + 2] * y[4 * k + 2]
        d += x[4 * k + 3] * y[4 * k + 3]
    return (a + b) + (c + d)


def project(U: Array, D: Array, psi: Array, F: Array, V: Array, size: int) -> float:
    """F = U' psi and V = D F; returns psi' P psi."""
    for j in range(size):
        a = 0.0
        b = 0.0
        c = 0.0
        d = 0.0
        row = j * size
        for k in range(j // 4 + 1):
            a += U[row + 4 * k] * psi[4 * k]
            b += U[row + 4 * k + 1] * psi[4 * k + 1]
            c += U[row + 4 * k + 2] * psi[4 * k + 2]
            d += U[row + 4 * k + 3] * psi[4 * k + 3]
        F[j] = (a + b) + (c + d)
        V[j] = D[j] * F[j]
    return inner(F, V, size)


def weigh(D: Array, F: Array, V: Array, size: int, w: float, fade: float) -> float:
    """D, and in F what each column of U takes of the sum before it; returns 1 + w psi' P psi."""
    beta = 1.0
    for j in range(size):
        before = beta
        beta = before + w * (F[j] * V[j])
        inverse = 1.0 / (before * beta)
        d = D[j] * (before * (before * inverse)) * fade
        if d > SMALLEST_VARIANCE:
            D[j] = d
        else:
            D[j] = SMALLEST_VARIANCE
        F[j] = (w * F[j]) * (beta * inverse)
    return beta


def sweep(U: Array, V: Array, F: Array, G: Array, size: int) -> float:
    """G = U V, while column j of U loses F[j] times what has been summed up before it."""
    for i in range(size):
        g = 0.0
        for j in range(i // 4 * 4, size):
            u = U[j * size + i]
            U[j * size + i] = u - F[j] * g
            g += V[j] * u
        G[i] = g
    return 0.0


def shift(past: Array, length: int) -> float:
    """Every number moves one place back; the first one stays, to be overwritten."""
    for back in range(1, length):
        past[length - back] = past[length - back - 1]
    return 0.0


def enter(past: Array, length: int, x: float) -> float:
    """Every number moves one place back and x comes in front; `length` is a multiple of 4."""
    for back in range(1, length):
        past[length - back] = past[length - back - 1]
    if length > 0:
        past[0] = x
    return 0.0


def copy(there: Array, here: Array, length: int) -> float:
    """`there` becomes what stands `here`."""
    for k in range(length):
        there[k] = here[k]
    return 0.0


def move(x: Array, y: Array, step: float, size: int) -> float:
    """Add step y to x."""
    for k in range(size):
        x[k] += step * y[k]
    return 0.0
