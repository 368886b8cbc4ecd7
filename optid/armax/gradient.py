"""Residuals of an ARMAX model over a recording, and their gradient.

e = (A y - B u) / C, and psi(t) = -de(t)/dtheta = phi(t) / C(q) (Ljung, System Identification, 2nd ed. 1999,
sec. 10.3). The nc residuals before a recording are noise like the others: they are estimated as well, with their
squares and the determinant in the criterion, as in the exact likelihood (Box, Jenkins and Reinsel, Time
Series Analysis, 3rd ed. 1994, sec. 7.1.4). If they are set to zero, slow roots of C carry the error far into the
recording and bias A and B: one of four poles then missed its 95 % interval with sensor noise
(`studies/armax_coverage.py`). The same is done after long gaps; after short ones the residuals start from
zero. A long recording's gradient is never stored completely: `information` reduces it to a triangle while it is
computed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from optid.armax.regression import BLOCK, reflect
from optid.armax.signals import Mask, Signals, usable
from optid.armax.structure import Orders
from optid.core.jit_cache import kept
from optid.core.model import Array

REACH = 1000  # largest number of samples over which residuals from before a run are followed
NOTHING = 1e-8  # share of such a residual that counts as zero
SHORTEST = 10  # times nc: a run shorter than that starts from zero residuals
MOST_OPENINGS = 20  # of a recording, those of its longest runs


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
    """Fill e (N,) where `keep` is true; returns their sum of squares, infinite where it overflows."""
    phi, total = np.empty(theta.size), 0.0
    for t in range(y.size):
        if not keep[t]:
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
def _information(y, u, keep, counted, theta, na, nbs, nks, nc, e, work):  # type: ignore[no-untyped-def]
    """Reflect [psi, e] of the samples `counted` into the triangle at the head of `work`, block by block."""
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
        if not counted[t]:
            continue
        for j in range(n):
            work[j, n + 1 + size] = psi[j]
        work[n, n + 1 + size] = e[t]
        size += 1
        if size == BLOCK:
            reflect(work, n + 1, size)
            size = 0
    reflect(work, n + 1, size)


@dataclass(frozen=True)
class Problem:
    """Recordings and orders that define a sum of squared one-step errors.

    Attributes:
        records: in the coordinates of the fit.
        keeps: where output and lags were measured, one mask a record.
        orders: with an input for each of the trend's parameters.
        count: number of residuals used.
        openings: first and last sample influenced by residuals from before a run, by record.
    """

    records: tuple[Signals, ...]
    keeps: tuple[Mask, ...]
    orders: Orders
    count: int
    openings: tuple[tuple[tuple[int, int], ...], ...]

    @classmethod
    def of(cls, records: Sequence[Signals], orders: Orders) -> Problem:
        """The problem of these recordings."""
        keeps = tuple(usable(record, orders) for record in records)
        for keep in keeps:
            keep[: orders.nc] = False
        count = int(sum(keep.sum() for keep in keeps))
        return cls(tuple(records), keeps, orders, count, tuple(openings(keep, orders.nc) for keep in keeps))

    def loss(self, theta: Array) -> float:
        """Mean squared residual, times the factor of the likelihood for the residuals before the recordings."""
        total = sum(_from_openings(*each, self.orders, theta)[1] for each in self._each())
        return total / self.count * self._of_openings(theta)

    def _of_openings(self, theta: Array) -> float:
        """exp(log det / count) of the information on the residuals before the recordings."""
        spent = _log_determinant(theta[self.orders.c_block], self._lengths())
        return math.exp(min(spent / self.count, 100.0)) if spent == spent else math.inf

    def _lengths(self) -> list[int]:
        return [end - first for opened in self.openings for first, end in opened]

    def information(self, theta: Array) -> Array:
        """Triangle R of [Psi, e] over all records, shape (n + 1, n + 1): R'R holds Psi'Psi, Psi'e and e'e.

        Without the part of Psi explained by the residuals before the recordings, which are estimated as well.
        """
        n = self.orders.parameters
        work, parts = np.zeros((n + 1, n + 1 + BLOCK)), []
        for record, keep, opened in self._each():
            e, _ = _from_openings(record, keep, opened, self.orders, theta)
            counted, reach = keep.copy(), decay(theta[self.orders.c_block])
            for first, end in opened:
                last = min(end, first + reach)
                counted[first:last] = False
                parts.append(_opening_information(record, keep, (first, last), self.orders, theta, e))
            _information(record.y, record.u, keep, counted, theta, *_shape(self.orders), e, work)
        R = np.triu(work[:, : n + 1].T)
        if not parts:
            return R
        R = np.asarray(np.linalg.qr(np.concatenate([R, *parts]), mode="r"))
        return self._with_determinant(R, theta)

    def _with_determinant(self, R: Array, theta: Array) -> Array:
        """The triangle with the gradient of `loss`: the determinant contributes where C decays slowly."""
        n, block, lengths = theta.size, self.orders.c_block, self._lengths()
        total, slope = float(np.sum(R[:, n] ** 2)), np.zeros(n)
        c = theta[block]
        for k, step in enumerate(1e-6 * np.eye(c.size)):
            ends = [_log_determinant(c + sign * step, lengths) for sign in (1.0, -1.0)]
            slope[block.start + k] = (ends[0] - ends[1]) / 2e-6
        if not np.all(np.isfinite(slope)):
            return R
        out = math.sqrt(self._of_openings(theta)) * R
        pull = np.linalg.lstsq(R[:n, :n].T, total / self.count / 2.0 * slope, rcond=1e-12)[0]
        out[:n, n] -= math.sqrt(self._of_openings(theta)) * pull
        left = total * self._of_openings(theta) - float(np.sum(out[:n, n] ** 2))
        out[n, n] = math.sqrt(max(left, 0.0))
        return out

    def _each(self) -> list[tuple[Signals, Mask, tuple[tuple[int, int], ...]]]:
        return list(zip(self.records, self.keeps, self.openings, strict=True))


def openings(keep: Mask, nc: int) -> tuple[tuple[int, int], ...]:
    """First and last sample (exclusive) of the head of each run that nc samples without residual precede."""
    if nc == 0:
        return ()
    edges = np.flatnonzero(np.diff(np.r_[False, keep, False].astype(int)))
    firsts, ends = edges[::2], edges[1::2]
    gaps = firsts - np.r_[0, ends[:-1]]
    long = np.flatnonzero((gaps >= nc) & (ends - firsts >= SHORTEST * nc))
    longest = long[np.argsort(firsts[long] - ends[long], kind="stable")[:MOST_OPENINGS]]
    return tuple((int(firsts[i]), int(min(ends[i], firsts[i] + REACH))) for i in sorted(longest))


def _from_openings(
    record: Signals, keep: Mask, opened: Sequence[tuple[int, int]], orders: Orders, theta: Array
) -> tuple[Array, float]:
    """e with the residuals before each opening estimated, shape (N,), and the sum of all squares."""
    e, nc, total, reach = np.zeros(record.y.size), orders.nc, 0.0, decay(theta[orders.c_block])
    for first, end in opened:
        last = min(end, first + reach)
        G = carried(theta[orders.c_block], last - first)
        local, at, shape = np.zeros(last - first + nc), slice(first - nc, last), _shape(orders)
        start = max(0, first - nc - orders.reach)
        part = np.zeros(last - start)
        _residuals(record.y[start:last], record.u[start:last], keep[start:last], theta, *shape, part)
        local[:] = part[at.start - start :]
        if not np.all(np.isfinite(local)) or not np.all(np.isfinite(G)):
            return e, np.inf
        before = np.linalg.solve(G.T @ G + np.eye(nc), -G.T @ local[nc:])
        e[first - nc : first] = before[::-1]
        total += float(before @ before)
    return e, total + float(_residuals(record.y, record.u, keep, theta, *_shape(orders), e))


def _opening_information(
    record: Signals, keep: Mask, opened: tuple[int, int], orders: Orders, theta: Array, e: Array
) -> Array:
    """Triangle of [Psi, e] over an opening, without the part explained by the residuals before it."""
    (first, last), nc, n = opened, orders.nc, orders.parameters
    start = max(0, first - nc - orders.reach)
    Psi = np.empty((last - start, n))
    part, before = e[start:last].copy(), e[first - nc : first][::-1]
    _gradient(record.y[start:last], record.u[start:last], keep[start:last], theta, *_shape(orders), part, Psi)
    of: Array = -carried(theta[orders.c_block], last - first)
    rows = np.column_stack([of, Psi[first - start :], e[first:last]])
    own = np.column_stack([-np.eye(nc), np.zeros((nc, n)), before])
    R: Array = np.asarray(np.linalg.qr(np.concatenate([rows, own]), mode="r"))
    return R[nc:, nc:]


def _log_determinant(c: Array, lengths: Sequence[int]) -> float:
    """Sum over the openings of log det(I + G'G): the determinant in a moving average's likelihood."""
    if not lengths or not c.size:
        return 0.0
    reach = decay(c)
    sizes = [min(length, reach) for length in lengths]
    G = carried(c, max(sizes))
    if not np.all(np.isfinite(G)):
        return math.nan
    each = {size: np.linalg.slogdet(np.eye(c.size) + G[:size].T @ G[:size])[1] for size in set(sizes)}
    return float(sum(each[size] for size in sizes))


def decay(c: Array) -> int:
    """Number of samples over which residuals from before are followed: until they have decayed."""
    largest = float(np.max(np.abs(np.roots(np.concatenate([[1.0], c]))), initial=0.0)) if c.size else 0.0
    if not 0.0 < largest < 1.0:
        return REACH if largest else SHORTEST
    return int(min(max(math.log(NOTHING) / math.log(largest), SHORTEST), REACH))


def carried(c: Array, samples: int) -> Array:
    """de(t)/de(-1 - j) from the residuals before t = 0 on, shape (samples, nc)."""
    from scipy.signal import lfilter

    pushed = np.zeros((samples, c.size))
    for j in range(c.size):
        pushed[: c.size - j, j] = -c[j:]
    return np.asarray(lfilter([1.0], np.concatenate([[1.0], c]), pushed, axis=0))


def residuals_and_gradient(record: Signals, keep: Mask, orders: Orders, theta: Array) -> tuple[Array, Array]:
    """e, shape (N,), and psi, shape (N, n), of one record, from residuals of zero; zero where `keep` is false."""
    e, _ = _squares(record, keep, orders, theta)
    Psi = np.empty((record.y.size, theta.size))
    _gradient(record.y, record.u, keep, theta, *_shape(orders), e, Psi)
    return e, Psi


def residuals_from_openings(record: Signals, orders: Orders, theta: Array) -> tuple[Array, Array]:
    """The same with the residuals before each opening estimated, as a fit sees them."""
    keep = usable(record, orders)
    keep[: orders.nc] = False
    e, _ = _from_openings(record, keep, openings(keep, orders.nc), orders, theta)
    Psi = np.empty((record.y.size, theta.size))
    _gradient(record.y, record.u, keep, theta, *_shape(orders), e, Psi)
    return np.where(keep, e, 0.0), Psi


def _squares(record: Signals, keep: Mask, orders: Orders, theta: Array) -> tuple[Array, float]:
    e = np.zeros(record.y.size)
    return e, float(_residuals(record.y, record.u, keep, theta, *_shape(orders), e))


def _shape(o: Orders) -> tuple[int, Array, Array, int]:
    return o.na, np.array(o.nb, dtype=np.int64), np.array(o.nk, dtype=np.int64), o.nc
