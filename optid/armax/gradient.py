"""Residuals of an ARMAX model over a recording, and their gradient.

e = (A y - B u) / C, and psi(t) = -de(t)/dtheta = phi(t) / C(q) (Ljung, System Identification, 2nd ed. 1999,
sec. 10.3). After a gap the residuals start again from zero. A long recording's gradient is never held as a whole:
`information` reduces it to a triangle while it is computed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from optid.armax.regression import BLOCK, reflect
from optid.armax.signals import Mask, Signals, usable
from optid.armax.structure import Orders
from optid.core.jit_cache import kept
from optid.core.model import Array

Lags = tuple[Array, Array]


@kept(error_model="numpy", nogil=True)
def _regressor(y, u, e, t, na, nbs, nks, nc, phi):  # type: ignore[no-untyped-def]
    """Fill phi(t); lags of e before the record are zero."""
    for k in range(na):
        phi[k] = -y[t - 1 - k]
    column = na
    for i in range(nbs.size):
        for k in range(nbs[i]):
            phi[column] = u[t - nks[i] - k, i]
            column += 1
    for k in range(nc):
        phi[column + k] = e[t - 1 - k] if t > k else 0.0


@kept(error_model="numpy", nogil=True)
def _residuals(y, u, keep, theta, na, nbs, nks, nc, e):  # type: ignore[no-untyped-def]
    """Fill e (N,), zero where `keep` is false; returns the sum of squares, infinite where it overflows."""
    phi, total = np.empty(theta.size), 0.0
    for t in range(y.size):
        if not keep[t]:
            e[t] = 0.0
            continue
        _regressor(y, u, e, t, na, nbs, nks, nc, phi)
        guess = 0.0
        for k in range(theta.size):
            guess += phi[k] * theta[k]
        e[t] = y[t] - guess
        total += e[t] * e[t]
    return total if total < 1e300 else np.inf


@kept(error_model="numpy", nogil=True)
def _gradient(y, u, keep, theta, na, nbs, nks, nc, e, Psi):  # type: ignore[no-untyped-def]
    """Fill psi (N, n), zero where `keep` is false."""
    n = theta.size
    for t in range(y.size):
        if not keep[t]:
            Psi[t, :] = 0.0
            continue
        _regressor(y, u, e, t, na, nbs, nks, nc, Psi[t])
        for k in range(min(nc, t)):
            share = theta[n - nc + k]
            for j in range(n):
                Psi[t, j] -= share * Psi[t - 1 - k, j]


@kept(error_model="numpy", nogil=True)
def _information(y, u, keep, theta, na, nbs, nks, nc, e, work):  # type: ignore[no-untyped-def]
    """Reflect [psi, e] of a record into the triangle at the head of `work`, block by block."""
    n, size = theta.size, 0
    past, psi = np.zeros((max(nc, 1), n)), np.empty(n)  # psi(t-1).. at t-1 modulo nc
    for t in range(y.size):
        if not keep[t]:
            past[t % past.shape[0], :] = 0.0
            continue
        _regressor(y, u, e, t, na, nbs, nks, nc, psi)
        for k in range(min(nc, t)):
            share, row = theta[n - nc + k], past[(t - 1 - k) % past.shape[0]]
            for j in range(n):
                psi[j] -= share * row[j]
        for j in range(n):
            past[t % past.shape[0], j] = psi[j]
            work[j, n + 1 + size] = psi[j]
        work[n, n + 1 + size] = e[t]
        size += 1
        if size == BLOCK:
            reflect(work, n + 1, size)
            size = 0
    reflect(work, n + 1, size)


@dataclass(frozen=True)
class Problem:
    """Recordings and orders between which a sum of squared one-step errors stands.

    Attributes:
        records: in the coordinates of the fit.
        keeps: where output and lags were measured, one mask a record.
        orders: with an input for each of the trend's parameters.
        count: residuals that count.
    """

    records: tuple[Signals, ...]
    keeps: tuple[Mask, ...]
    orders: Orders
    count: int

    @classmethod
    def of(cls, records: Sequence[Signals], orders: Orders) -> Problem:
        """The problem of these recordings."""
        keeps = tuple(usable(record, orders) for record in records)
        return cls(tuple(records), keeps, orders, int(sum(keep.sum() for keep in keeps)))

    def loss(self, theta: Array) -> float:
        """Mean squared residual."""
        return sum(_squares(r, k, self.orders, theta)[1] for r, k in self._pairs()) / self.count

    def information(self, theta: Array) -> Array:
        """Triangle R of [Psi, e] over all records, shape (n + 1, n + 1): R'R holds Psi'Psi, Psi'e and e'e."""
        n = self.orders.parameters
        work = np.zeros((n + 1, n + 1 + BLOCK))
        for record, keep in self._pairs():
            e, _ = _squares(record, keep, self.orders, theta)
            _information(record.y, record.u, keep, theta, *_shape(self.orders), e, work)
        return np.triu(work[:, : n + 1].T)

    def residuals(self, theta: Array) -> tuple[Array, Array]:
        """e and psi over all records, shapes (N,) and (N, n)."""
        es, Psis = [], []
        for record, keep in self._pairs():
            e, Psi = residuals_and_gradient(record, keep, self.orders, theta)
            es.append(e[keep])
            Psis.append(Psi[keep])
        return np.concatenate(es), np.concatenate(Psis)

    def _pairs(self) -> list[tuple[Signals, Mask]]:
        return list(zip(self.records, self.keeps, strict=True))


def residuals_and_gradient(record: Signals, keep: Mask, orders: Orders, theta: Array) -> tuple[Array, Array]:
    """e, shape (N,), and psi, shape (N, n), of one record; zero where `keep` is false."""
    e, _ = _squares(record, keep, orders, theta)
    Psi = np.empty((record.y.size, theta.size))
    _gradient(record.y, record.u, keep, theta, *_shape(orders), e, Psi)
    return e, Psi


def _squares(record: Signals, keep: Mask, orders: Orders, theta: Array) -> tuple[Array, float]:
    e = np.empty(record.y.size)
    return e, float(_residuals(record.y, record.u, keep, theta, *_shape(orders), e))


def _shape(o: Orders) -> tuple[int, Array, Array, int]:
    return o.na, np.array(o.nb, dtype=np.int64), np.array(o.nk, dtype=np.int64), o.nc
