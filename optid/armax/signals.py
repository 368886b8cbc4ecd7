"""Recorded arrays as the identification wants them: checked, two-dimensional, missing samples marked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from optid.armax.structure import Orders
from optid.core.model import Array
from optid.errors import NotIdentifiable, RecordingError

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Signals:
    """One recording of an output y, shape (N,), and inputs u, shape (N, m); NaN is a missing sample.

    `first` counts the samples of the recording before this part of it.
    """

    y: Array
    u: Array
    first: int = 0

    def __post_init__(self) -> None:
        if self.y.ndim != 1 or self.u.ndim != 2 or self.u.shape[0] != self.y.size:
            raise RecordingError(
                f"output {self.y.shape} and input {self.u.shape}",
                field="y, u",
                expected="shapes (N,) and (N,) or (N, inputs)",
            )

    @property
    def scales(self) -> tuple[float, Array]:
        """Root mean square of the output and of each input, 1 for a signal that is zero."""

        def size(x: Array) -> float:
            x = x[np.isfinite(x)]
            largest = float(np.max(np.abs(x), initial=0.0))
            return largest * float(np.sqrt(np.mean((x / largest) ** 2))) if largest > 0.0 else 1.0

        return size(self.y), np.array([size(column) for column in self.u.T])

    def part(self, start: int, stop: int | None = None) -> Signals:
        """Samples from start to stop."""
        return Signals(self.y[start:stop], self.u[start:stop], self.first + start)

    def excerpts(self, most: int, pieces: int = 8) -> list[Signals]:
        """The whole where it is no longer than `most` samples, else as many in pieces spread evenly over it."""
        if self.y.size <= most:
            return [self]
        length, last = most // pieces, self.y.size - most // pieces
        return [
            self.part(start, start + length) for start in np.linspace(0, last, pieces).astype(int).tolist()
        ]


def signals(y: ArrayLike, u: ArrayLike | None = None) -> Signals:
    """Check arrays and bring them into shape; without `u` the output stands alone (ARMA)."""
    output = np.ascontiguousarray(y, dtype=float)
    size = output.shape[0] if output.ndim else 0
    inputs = np.zeros((size, 0)) if u is None else np.asarray(u, dtype=float)
    if inputs.ndim == 1:
        inputs = inputs[:, None]
    return Signals(output, np.ascontiguousarray(inputs))


def check_orders(records: Sequence[Signals], orders: Orders) -> None:
    """Refuse recordings that cannot determine a model of these orders.

    Raises:
        RecordingError: the number of inputs is not the orders'.
        NotIdentifiable: fewer complete samples than parameters.
    """
    for record in records:
        if record.u.shape[1] != orders.inputs:
            raise RecordingError(
                f"{record.u.shape[1]} inputs", field="u", expected=f"{orders.inputs}, as the orders say"
            )
    rows = sum(int(usable(record, orders).sum()) for record in records)
    if rows <= orders.parameters:
        raise NotIdentifiable(
            f"{rows} complete samples cannot determine the {orders.parameters} parameters of {orders}"
        )


def usable(record: Signals, orders: Orders) -> Mask:
    """True where the output and everything its regressor needs were measured, shape (N,)."""
    lost = ~np.isfinite(record.y)
    bad = lost.copy()
    bad[: orders.reach] = True
    for lag in range(1, orders.na + 1):
        bad[lag:] |= lost[:-lag]
    for i, (nb, nk) in enumerate(zip(orders.nb, orders.nk, strict=True)):
        gone = ~np.isfinite(record.u[:, i])
        for lag in range(nk, nk + nb):
            bad[lag:] |= gone[: gone.size - lag] if lag else gone
    return np.asarray(~bad)
