"""The recursion over whole recordings: `identify`, and a start that agrees with batch least squares."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from optid.armax import layout as at
from optid.armax.identifier import NOISE, Counts, Identifier, Settings
from optid.armax.model import Armax
from optid.armax.regression import arx_rows, solve
from optid.armax.signals import Signals, check_orders, signals, usable
from optid.armax.structure import Orders
from optid.armax.trend import Frame, Trend
from optid.core.model import Array
from optid.errors import NotIdentifiable

if TYPE_CHECKING:
    import pandas as pd

HEAD = 4  # divisor: the noise is estimated from this share of first samples
FEW = 20_000  # and in no more than these
LONG = 10  # coefficients of the long ARX model that does it


def exact_start(identifier: Identifier, y: ArrayLike, u: ArrayLike | None, rows: int | None = None) -> int:
    """Start a new identifier with the least-squares fit of the first samples instead of a guess.

    With lambda = 1 an ARX identifier then gives the batch least-squares estimate of all samples it has seen.
    The coefficients of C begin at zero with the start variance.

    Args:
        identifier: before its first sample.
        y, u: the recording.
        rows: complete samples to fit; as few as possible where None.

    Returns:
        number of samples used: continue with the next one.

    Raises:
        NotIdentifiable: the recording does not determine the parameters of A and B.
    """
    record = signals(y, u)
    orders, state = identifier.orders, identifier._state
    check_orders([record], orders)
    plain = Orders(orders.na, orders.nb, 0, orders.nk)
    where = np.flatnonzero(usable(record, plain))
    scaled = Signals(record.y / state[at.SCALE], record.u * _input_factors(identifier))
    p, n = plain.parameters, orders.parameters
    count = rows or p
    while True:
        if count > where.size:
            raise NotIdentifiable(f"the recording does not determine the {p} parameters of A and B")
        used = int(where[count - 1]) + 1
        Phi, target = arx_rows(scaled.part(0, used), plain)
        Q, R = np.linalg.qr(Phi)
        diagonal = np.abs(np.diag(R))
        if diagonal.min() > 1e-9 * diagonal.max():
            break
        count += max(1, count // 4)
    theta = np.linalg.solve(R, Q.T @ target)
    T = np.linalg.inv(R)  # upper triangular, P = T T' = U D U' with U = T / diag(T)
    identifier.run(record.y[:used], record.u[:used])  # fills the histories
    start, size = at.theta_at(orders), at.stride(orders)
    state[start : start + n] = np.concatenate([theta, np.zeros(n - p)])
    D = identifier.settings.start_variances(orders)
    D[:p] = np.diag(T) ** 2
    U = np.eye(size)
    U[:p, :p] = T / np.diag(T)
    start = at.diagonal_at(orders)
    state[start : start + n] = D
    start = at.triangle_at(orders)
    state[start : start + size * size] = U.T.ravel()
    state[at.TRACE] = float(np.sum((U[:n, :n] * D) * U[:n, :n]))
    state[at.UPDATES] = state[at.WEIGHT] = Phi.shape[0]
    state[at.SQUARES] = float(np.sum((target - Phi @ theta) ** 2))
    places = at.places(orders)
    state[places[at.RESIDUALS] : places[at.PAST_INPUTS]] = 0.0
    return used


def _input_factors(identifier: Identifier) -> Array:
    table = identifier._state[at.table_at() : at.table_at() + 3 * identifier.orders.inputs]
    return table[2::3]


@dataclass(frozen=True)
class Identification:
    """The result of a recursion over a whole recording.

    Attributes:
        model: the last estimate.
        innovations: error of each one-step prediction before the update, shape (N,).
        track: theta after every `every` samples, shape (rows, parameters).
        every: samples between two rows of `track`.
        counts: of processed samples.
        state: the identifier's memory after the last sample, for signals centred and scaled as in `Frame`.
    """

    model: Armax
    innovations: Array
    track: Array
    every: int
    counts: Counts
    state: Array

    def frame(self) -> pd.DataFrame:
        """The track of the parameters as a table, indexed by time in seconds."""
        import pandas as pd

        times = (np.arange(self.track.shape[0]) + 1) * self.every * self.model.sample_time
        return pd.DataFrame(self.track, columns=names(self.model.orders), index=pd.Index(times, name="time"))


def names(orders: Orders) -> list[str]:
    """Names of the entries of theta: a1.., b0.. (b1_0 with several inputs), c1.."""
    several = orders.inputs > 1
    out = [f"a{i + 1}" for i in range(orders.na)]
    for k, nb in enumerate(orders.nb):
        out += [f"b{k + 1}_{i}" if several else f"b{i}" for i in range(nb)]
    return out + [f"c{i + 1}" for i in range(orders.nc)]


def noise_share(record: Signals, orders: Orders) -> float:
    """Standard deviation of the innovation as a share of the output's scale, by a long ARX model."""
    scale, inputs = record.scales
    head = record.part(0, min(max(record.y.size // HEAD, 20 * (LONG + orders.parameters)), FEW))
    scaled = Signals(head.y / scale, head.u / inputs)
    long = Orders(max(LONG, orders.na), tuple(max(LONG, nb) for nb in orders.nb), 0, orders.nk)
    Phi, y = arx_rows(scaled, long)
    if y.size <= long.parameters:
        return NOISE
    squares = float(np.sum((y - Phi @ solve(Phi, y)) ** 2))
    return float(np.clip(np.sqrt(squares / (y.size - long.parameters)), 1e-6, 1.0))


def identify(
    y: ArrayLike,
    u: ArrayLike | None,
    orders: Orders,
    sample_time: float = 1.0,
    settings: Settings | None = None,
    every: int = 0,
    start: ArrayLike | None = None,
    *,
    trend: Trend = Trend.NONE,
) -> Identification:
    """Run the recursion over a whole recording.

    Args:
        y: output, shape (N,); NaN where it is missing.
        u: input, shape (N,) or (N, inputs), None for an ARMA model.
        orders: of eq. 12.
        sample_time: seconds.
        settings: of the recursion.
        every: store theta every `every` samples; 0 stores about a thousand rows.
        start: initial theta; zeros if None.
        trend: terms added to eq. 12, as further inputs.

    Raises:
        RecordingError: arrays of shapes that do not fit.
        NotIdentifiable: fewer complete samples than parameters.
    """
    record = signals(y, u)
    check_orders([record], orders)
    settings = settings or Settings()
    frame = Frame.of([record], orders, sample_time, trend)
    inner, full = frame.augmented(record), frame.full_orders
    if settings.noise is None:
        settings = replace(settings, noise=noise_share(inner, full))
    identifier = Identifier(full, sample_time, settings)
    if start is not None:
        identifier.start_at(frame.entered(np.asarray(start, dtype=float)))
    every = every or max(1, record.y.size // 1000)
    innovations, track = identifier.run(inner.y, inner.u, every)
    M, m = frame.affine()
    own = np.r_[0 : orders.parameters - orders.nc, full.c_block]
    variance = identifier.noise_variance * frame.output**2
    return Identification(
        frame.model(identifier.theta, variance, identifier.covariance),
        innovations * frame.output,
        (track @ M.T + m)[:, own],
        every,
        identifier.counts,
        identifier.state,
    )
