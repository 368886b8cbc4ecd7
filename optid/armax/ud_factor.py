"""The arithmetic of P = U D U' over padded arrays, in the small language that `optid.core.translate` writes in C.

Bierman's update (Factorization Methods for Discrete Sequential Estimation, 1977, ch. V), written with
beta_j = 1 + w (f_1 v_1 + .. + f_j v_j) so that the weight w of a sample may be zero or, for directional
forgetting, negative. Arrays of the parameters hold `size` numbers, a multiple of 4, U `size` columns of as
many; behind the parameters stand zeros, and ones on U's diagonal. Sums run in four lanes, as processors add
vectors, and running sums in as few steps as they can.

These functions are the reference; `optid.armax.ud_simd` does the same with vector instructions.
"""

from __future__ import annotations

from optid.core.model import Array

SMALLEST_VARIANCE = 1e-200  # of D: far below anything data can reach, far above underflow


def inner(x: Array, y: Array, length: int) -> float:
    """x' y."""
    a = 0.0
    b = 0.0
    c = 0.0
    d = 0.0
    for k in range(length // 4):
        a += x[4 * k] * y[4 * k]
        b += x[4 * k + 1] * y[4 * k + 1]
        c += x[4 * k + 2] * y[4 * k + 2]
        d += x[4 * k + 3] * y[4 * k + 3]
    total = (a + b) + (c + d)
    for k in range(length // 4 * 4, length):
        total += x[k] * y[k]
    return total


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
    before = 1.0
    inverse = 1.0
    for k in range(size // 4):
        x = w * (F[4 * k] * V[4 * k])
        y = w * (F[4 * k + 1] * V[4 * k + 1])
        z = w * (F[4 * k + 2] * V[4 * k + 2])
        last = w * (F[4 * k + 3] * V[4 * k + 3])
        start = before
        for j in range(4):
            beta = start + x
            if j == 1:
                beta = start + (y + x)
            if j == 2:
                beta = start + ((z + y) + x)
            if j == 3:
                beta = start + ((last + z) + (y + x))
            F[4 * k + j] = (w * F[4 * k + j]) * inverse
            inverse = 1.0 / beta
            d = (D[4 * k + j] * fade) * (before * inverse)
            if d > SMALLEST_VARIANCE:
                D[4 * k + j] = d
            else:
                D[4 * k + j] = SMALLEST_VARIANCE
            before = beta
    return before


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
