"""Linear regressions: ARX by least squares, and the first guess of an ARMAX fit."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from optid.armax.signals import Mask, Signals, usable
from optid.armax.structure import Orders
from optid.core.jit_cache import kept
from optid.core.model import Array

BLOCK = 256  # rows


def arx_rows(record: Signals, orders: Orders, residuals: Array | None = None) -> tuple[Array, Array]:
    """Regressors and outputs of all samples whose lags were measured: Phi (rows, n) and y (rows,).

    With `residuals`, shape (N,), their lags take the place of the noise's; NaN there drops a row.
    """
    N = record.y.size
    keep: Mask = usable(record, orders)
    columns = [-lagged(record.y, k) for k in range(1, orders.na + 1)]
    for i, (nb, nk) in enumerate(zip(orders.nb, orders.nk, strict=True)):
        columns += [lagged(record.u[:, i], k) for k in range(nk, nk + nb)]
    if residuals is not None:
        columns += [lagged(residuals, k) for k in range(1, orders.nc + 1)]
    Phi = np.column_stack(columns) if columns else np.zeros((N, 0))
    keep = keep & np.isfinite(Phi).all(axis=1)
    return Phi[keep], record.y[keep]


def lagged(x: Array, lag: int) -> Array:
    """x(t - lag), NaN before the record, shape (N,)."""
    if lag == 0:
        return x
    return np.concatenate([np.full(min(lag, x.size), np.nan), x[: max(x.size - lag, 0)]])


def least_squares(records: Sequence[Signals], orders: Orders) -> Array:
    """Theta of an ARX model by batch least squares (QR), shape (na + nb,)."""
    plain = Orders(orders.na, orders.nb, 0, orders.nk)
    rows = [arx_rows(record, plain) for record in records]
    Phi, y = np.concatenate([r[0] for r in rows]), np.concatenate([r[1] for r in rows])
    return solve(Phi, y)


def solve(Phi: Array, y: Array) -> Array:
    """Least squares with equilibrated columns; the shortest of all solutions where there are many."""
    size = column_sizes(Phi)
    R = triangle(np.column_stack([Phi / size, y]))
    theta: Array = np.linalg.lstsq(R[:, :-1], R[:, -1], rcond=1e-13)[0] / size
    return theta


def column_sizes(Phi: Array) -> Array:
    """Length of each column, 1 for one that is zero."""
    size: Array = np.sqrt(np.sum(Phi**2, axis=0))
    size[size == 0.0] = 1.0
    return size


def triangle(tall: Array) -> Array:
    """R of a QR factorisation by Householder reflections, shape (n, n), with M'M = R'R.

    Compiled here instead of taken from the linear algebra library, whose threads, waking for every
    factorisation of a search, cost twenty times the arithmetic on a busy machine.
    """
    R: Array = _triangle(np.ascontiguousarray(tall))
    return R


@kept(error_model="numpy", nogil=True, fastmath={"reassoc", "contract"})
def _triangle(tall):  # type: ignore[no-untyped-def]
    """Block by block: the triangle so far lies above the next rows, and both are reflected together."""
    rows, n = tall.shape
    work = np.zeros((n, n + BLOCK))  # columns of the matrix are rows here
    for first in range(0, rows, BLOCK):
        size = min(BLOCK, rows - first)
        for i in range(size):
            for j in range(n):
                work[j, n + i] = tall[first + i, j]
        reflect(work, n, size)
    triangle = np.zeros((n, n))  # a loop: np.triu takes seconds to compile
    for j in range(n):
        for i in range(j + 1):
            triangle[i, j] = work[j, i]
    return triangle


@kept(error_model="numpy", nogil=True, fastmath={"reassoc", "contract"})
def reflect(work, n, size):  # type: ignore[no-untyped-def]
    """Householder reflections that bring `size` rows behind a triangle of n columns into it."""
    for j in range(n):
        below = 0.0
        for i in range(n, n + size):
            below += work[j, i] * work[j, i]
        if below == 0.0:
            continue
        head = math.copysign(math.sqrt(work[j, j] * work[j, j] + below), work[j, j])
        lead = work[j, j] + head
        scale = 1.0 / (head * lead)
        for k in range(j + 1, n):
            dot = lead * work[k, j]
            for i in range(n, n + size):
                dot += work[j, i] * work[k, i]
            dot *= scale
            work[k, j] -= dot * lead
            for i in range(n, n + size):
                work[k, i] -= dot * work[j, i]
        work[j, j] = -head


def hannan_rissanen(records: Sequence[Signals], orders: Orders, long: int) -> Array:
    """Theta of an ARMAX model in two regressions, shape (n,).

    A long ARX model estimates the noise, which then stands in the regressor (Hannan and Rissanen, Biometrika
    69, 1982). With nc = 0 this is least squares.
    """
    if orders.nc == 0:
        return least_squares(records, orders)
    deep = Orders(long, tuple(max(nb, long) for nb in orders.nb), 0, orders.nk)
    theta = least_squares(records, deep)
    Phis, ys = [], []
    for record in records:
        Phi, y = arx_rows(record, deep)
        residuals = np.full(record.y.size, np.nan)
        residuals[usable(record, deep)] = y - Phi @ theta
        rows = arx_rows(record, orders, residuals)
        Phis.append(rows[0])
        ys.append(rows[1])
    return solve(np.concatenate(Phis), np.concatenate(ys))
