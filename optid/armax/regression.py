"""Linear regressions: ARX by least squares, and the first guess of an ARMAX fit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from optid.armax.signals import Mask, Signals, usable
from optid.armax.structure import Orders
from optid.core.model import Array


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
    return np.concatenate([np.full(min(lag, x.size), np.nan), x[: x.size - lag]])


def least_squares(records: Sequence[Signals], orders: Orders) -> Array:
    """Theta of an ARX model by batch least squares (QR), shape (na + nb,)."""
    plain = Orders(orders.na, orders.nb, 0, orders.nk)
    rows = [arx_rows(record, plain) for record in records]
    Phi, y = np.concatenate([r[0] for r in rows]), np.concatenate([r[1] for r in rows])
    return solve(Phi, y)


def solve(Phi: Array, y: Array) -> Array:
    """Least squares with equilibrated columns; the shortest of all solutions where there are many."""
    size = np.sqrt(np.sum(Phi**2, axis=0))
    size[size == 0.0] = 1.0
    theta: Array = np.linalg.lstsq(Phi / size, y, rcond=1e-13)[0] / size
    return theta


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
