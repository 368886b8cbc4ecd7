"""Combinations of coefficients that the data do not determine, and why.

A combination is open where the regressors hardly move along it: to the last digit (a noise-free common factor), or
no further than the rounding of the recorded numbers moves them (an input that follows from earlier outputs, from
another input, or from a few of its own samples). Its variance is infinite; least squares would report a value due to
rounding, or, by dropping the direction, none.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from optid.armax.signals import Signals
from optid.armax.structure import Orders
from optid.core.model import Array

OPEN = 1e-9  # share of the largest singular value of Psi below which a direction counts as open
ROUNDING = 3.0  # times the effect of rounding: a direction with no larger effect is open
OWN = 0.01  # share of an input in a direction from which it is attributed to the input
TOUCHED = 1e-3  # share of an undetermined direction, of unit length, above which it concerns a coefficient
DIGITS = 15  # decimal places examined
LOOKED_AT = 2000  # samples whose digits are examined
FINE = 1e-3  # share of a signal's standard deviation up to which its step counts as rounding
HARDLY = 0.02  # share of an input from outside a loop that counts as very small
# Of the part not predicted by its own past: an input that follows the output leaves at most this.
BY_OUTPUT = 0.3
EXCITED = 24  # lags over which the order of excitation is counted


class Reason(enum.Enum):
    """Why a direction is open; the value is a sentence."""

    IDLE_INPUT = "the input is constant"
    POOR_EXCITATION = "each sample of the input follows from its earlier samples"
    FOLLOWING_INPUTS = "the inputs are linearly dependent"
    FEEDBACK = "the input is a function of earlier outputs: a closed loop without external excitation"
    COMMON_FACTOR = "A, B and C share a factor: the order is higher than the data support"


@dataclass(frozen=True)
class OpenDirection:
    """A combination of coefficients that the data do not determine.

    Attributes:
        reason: why.
        inputs: numbers of the inputs concerned, from 0 on.
        coefficients: indices in theta that it changes.
    """

    reason: Reason
    inputs: tuple[int, ...]
    coefficients: tuple[int, ...]


def rounding(x: Array) -> float:
    """The step of the last digit a signal was recorded with: a decimal one, a float32's or a float64's."""
    known = x[np.isfinite(x)]
    largest = float(np.max(np.abs(known), initial=0.0))
    if largest == 0.0:
        return 0.0
    some = known[:: max(1, known.size // LOOKED_AT)]
    for places in range(-3, DIGITS + 1):
        scaled = some * 10.0**places
        if float(np.max(np.abs(scaled))) > 1e11:
            break
        if np.all(np.abs(scaled - np.round(scaled)) < 1e-3) and np.any(np.round(scaled) != 0.0):
            if 10.0**-places > FINE * float(np.std(some)):  # levels of a binary signal are not rounding
                return largest * float(np.finfo(float).eps)
            return 10.0**-places
    if np.array_equal(some.astype(np.float32).astype(float), some):
        return largest * float(np.finfo(np.float32).eps)
    # Text files usually keep twelve significant digits of a number without a last place.
    return largest * (1e-12 if np.all(_twelve(some)) else float(np.finfo(float).eps))


def _twelve(x: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 10.0 ** (12 - np.ceil(np.log10(np.abs(x))))
        scaled = x * scale
    return np.asarray(~np.isfinite(scaled) | (np.abs(scaled - np.round(scaled)) < 0.02))


def excitation(u: Array, lags: int = EXCITED) -> int:
    """Order of excitation of an input, at most `lags`: independent lagged samples, in addition to a constant.

    A sine has order 2, k sines order 2 k, white noise any (Ljung 1999, definition 13.2).
    """
    from optid.armax.regression import arx_rows, triangle

    column = np.ascontiguousarray(u[: 200 * lags, None])
    record = Signals(np.where(np.isfinite(u[: 200 * lags]), 0.0, np.nan), column)
    Phi, _ = arx_rows(record, Orders(0, (lags,), 0, (0,)))
    if Phi.shape[0] < 2 * lags:
        return lags
    R = triangle(np.column_stack([np.ones(Phi.shape[0]), Phi]))[1:, 1:]
    noise = ROUNDING * rounding(u) / math.sqrt(12.0) * math.sqrt(Phi.shape[0])
    singular = np.linalg.svd(R, compute_uv=False)
    return int(np.sum(singular > max(noise, OPEN * float(singular[0]))))


def follows_output(record: Signals, lags: int = EXCITED) -> tuple[int, ...]:
    """Inputs determined exactly by earlier outputs and inputs: a loop without external excitation.

    Excluded are those determined by their own past alone, for which `excitation` is low.
    """
    from optid.armax.regression import arx_rows, triangle

    short = record.part(0, 400 * lags)
    found = []
    for i, column in enumerate(short.u.T):
        inner = Signals(np.where(np.isfinite(column), column, np.nan), np.column_stack([short.y, column]))
        Phi, now = arx_rows(inner, Orders(0, (lags, lags), 0, (0, 1)))
        if now.size < 4 * lags or np.ptp(column[np.isfinite(column)]) == 0.0 or excitation(column) < lags:
            continue
        sizes = np.sqrt(np.mean(Phi**2, axis=0))
        sizes[sizes == 0.0] = 1.0
        R = triangle(np.column_stack([np.ones(now.size), Phi / sizes, now]))
        scaled = np.linalg.lstsq(R[:-1, :-1], R[:-1, -1], rcond=1e-6)[0]
        through = scaled[1:] / sizes
        missed = float(np.linalg.norm(R[:-1, -1] - R[:-1, :-1] @ scaled))
        steps = np.r_[np.full(lags, rounding(short.y)), np.full(lags, rounding(column))]
        floor = math.hypot(float(np.linalg.norm(through * steps)), rounding(column)) / math.sqrt(12.0)
        left = math.hypot(float(R[-1, -1]), missed) / math.sqrt(now.size)
        if left <= max(ROUNDING * floor, OPEN * float(np.std(now))):
            found.append(i)
    return tuple(found)


def loop_share(record: Signals, lags: int = EXCITED) -> tuple[tuple[int, float], ...]:
    """Inputs nearly determined by earlier outputs and inputs, and the share that is not.

    A controller's converter rounds, so that a loop without external excitation seems excited by the rounding. Excluded
    are those that their own past predicts equally well.
    """
    from optid.armax.regression import arx_rows, triangle

    short = record.part(0, 400 * lags)
    found = []
    for i, column in enumerate(short.u.T):
        inner = Signals(np.where(np.isfinite(column), column, np.nan), np.column_stack([column, short.y]))
        Phi, now = arx_rows(inner, Orders(0, (lags, lags), 0, (1, 0)))
        if now.size < 4 * lags or np.ptp(now) == 0.0:
            continue
        R = triangle(np.column_stack([np.ones(now.size), Phi, now]))
        left, alone = abs(float(R[-1, -1])), float(np.linalg.norm(R[1 + lags :, -1]))
        share = left / (math.sqrt(now.size) * float(np.std(now)))
        if share <= HARDLY and left <= BY_OUTPUT * alone:
            found.append((i, share))
    return tuple(found)


@dataclass(frozen=True)
class Directions:
    """The open directions of a fit.

    Attributes:
        basis: orthonormal, in columns of Psi divided by their lengths, shape (n, k).
        named: description of each.
    """

    basis: Array
    named: tuple[OpenDirection, ...]

    @property
    def touched(self) -> Array:
        """Parameters that they involve, shape (n,)."""
        return np.asarray(np.any(np.abs(self.basis) > TOUCHED, axis=1))


def open_directions(R: Array, orders: Orders, inputs: int, floor: Array) -> Directions:
    """The directions that data with this triangle leave open.

    Args:
        R: triangle of Psi, its columns of unit length or zero, shape (n, n).
        orders: with the trend's inputs behind the others.
        inputs: number of inputs without the trend's.
        floor: norm of the effect of rounding on each column, shape (n,).
    """
    n = orders.parameters
    blocks = list(orders.blocks())
    B = _indices(blocks[:inputs])
    trend = _indices(blocks[inputs:])
    others = np.setdiff1d(np.arange(n), B)
    found: list[Array] = []
    named: list[OpenDirection] = []
    for known, reason in ((trend, Reason.POOR_EXCITATION), (others, Reason.FEEDBACK)):
        for direction in _without_news(R, B, known, floor):
            rest = _beyond(direction, found)
            if rest is not None:
                found.append(rest)
                named.append(_named(direction, reason, R, blocks[:inputs], orders))
    left = _projected(R, found)
    _, singular, Vt = np.linalg.svd(left)
    for k in np.flatnonzero(singular <= OPEN * max(float(singular[0]), 1e-300)):
        rest = _beyond(Vt[k], found)
        if rest is not None:
            found.append(rest)
            named.append(_named(rest, Reason.COMMON_FACTOR, R, blocks[:inputs], orders))
    return Directions(np.column_stack(found) if found else np.zeros((n, 0)), tuple(named))


def _indices(blocks: Sequence[slice]) -> Array:
    return np.array([i for b in blocks for i in range(b.start, b.stop)], dtype=np.int64)


def _without_news(R: Array, wanted: Array, known: Array, floor: Array) -> list[Array]:
    """Combinations of the columns `wanted` that, given those `known`, are within rounding."""
    if not wanted.size:
        return []
    n, p = R.shape[1], known.size
    T = np.asarray(np.linalg.qr(R[:, np.concatenate([known, wanted])], mode="r"))
    _, singular, Vt = np.linalg.svd(T[p:, p:])
    out = []
    for k in range(wanted.size):
        w = Vt[k]
        s = float(singular[k]) if k < singular.size else 0.0
        through = np.linalg.lstsq(T[:p, :p], T[:p, p:] @ w, rcond=1e-10)[0] if p else np.empty(0)
        alone = math.hypot(
            float(np.linalg.norm(floor[wanted] * w)), float(np.linalg.norm(floor[known] * through))
        )
        if s <= max(OPEN, ROUNDING * alone):
            direction = np.zeros(n)
            direction[known], direction[wanted] = -through, w
            direction = direction / np.linalg.norm(direction)
            # Where the inputs hardly contribute, small differences of the output are normal.
            if s <= OPEN or float(np.max(np.abs(direction[wanted]))) > OWN:
                out.append(direction)
    return out


def _beyond(direction: Array, found: Sequence[Array]) -> Array | None:
    """The part of a direction orthogonal to those found before, of unit length; None where that is zero."""
    rest = direction.copy()
    for other in found:
        rest -= (other @ rest) * other
    length = float(np.linalg.norm(rest))
    return rest / length if length > 1e-3 else None


def _projected(R: Array, found: Sequence[Array]) -> Array:
    """R after projection, in which the directions found no longer appear as short."""
    out = R.copy()
    for direction in found:
        out = out - np.outer(out @ direction, direction)
    scale = float(np.linalg.norm(R, 2)) if R.size else 1.0
    return np.concatenate([out, *(scale * direction[None, :] for direction in found)])


def _named(
    direction: Array, reason: Reason, R: Array, blocks: Sequence[slice], orders: Orders
) -> OpenDirection:
    touched = np.flatnonzero(np.abs(direction) > TOUCHED)
    inputs = tuple(i for i, b in enumerate(blocks) if np.any((touched >= b.start) & (touched < b.stop)))
    if reason is Reason.POOR_EXCITATION:
        if all(not np.any(R[:, blocks[i]]) for i in inputs):
            reason = Reason.IDLE_INPUT
        elif len(inputs) > 1:
            reason = Reason.FOLLOWING_INPUTS
    elif reason is Reason.FEEDBACK:
        # In a controller's law the input has the newest sample; if the output's is newer, it follows from the input.
        lags = [int(k) + 1 for k in touched if k < orders.na]
        acts = [orders.nk[i] + int(touched[touched >= blocks[i].start][0]) - blocks[i].start for i in inputs]
        if lags and acts and min(lags) < min(acts):
            reason = Reason.COMMON_FACTOR
    return OpenDirection(reason, inputs, tuple(int(i) for i in touched))
