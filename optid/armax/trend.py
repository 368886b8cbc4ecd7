"""Operating point and trend as part of the model: two more inputs, one that is 1 and one that grows with time.

A recording away from zero satisfies eq. 12 only relative to its operating point, which is not known exactly. Estimated
with the coefficients, constant and slope cost two parameters; left out, they appear as a pole and a zero at 1 and a
wrong static gain (Ljung, System Identification, 2nd ed. 1999, sec. 14.1).
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from optid.armax.model import Armax, from_theta
from optid.armax.regression import arx_rows, triangle
from optid.armax.signals import Signals
from optid.armax.structure import Orders
from optid.core.model import Array

# Standard errors beyond which a slope is estimated as well. With 4.5 a third of the poles missed their 95 %
# intervals due to an overlooked trend; with 2 spurious slopes bias poles as well (studies/armax_coverage.py).
SURE = 3.0
LONG = 10  # coefficients of the regression that detects a slope


class Trend(enum.Enum):
    """Terms added to eq. 12; the value is the number of parameters."""

    NONE = 0
    CONSTANT = 1
    LINEAR = 2


@dataclass(frozen=True)
class Frame:
    """The coordinates in which a model is estimated: signals centred and scaled, the trend as inputs.

    Attributes:
        orders: of the model.
        trend: terms added to eq. 12.
        sample_time: seconds.
        output, inputs: sizes, by which signals are divided.
        output_centre, input_centres: subtracted first; 0 without a trend.
        middle, half: of the recordings' span, samples.
    """

    orders: Orders
    trend: Trend
    sample_time: float
    output: float
    inputs: Array
    output_centre: float
    input_centres: Array
    middle: float
    half: float

    @classmethod
    def of(cls, records: Sequence[Signals], orders: Orders, sample_time: float, trend: Trend) -> Frame:
        """Centres and sizes of these recordings."""
        y = np.concatenate([r.y for r in records])
        u = np.concatenate([r.u for r in records])
        centre, centres = 0.0, np.zeros(orders.inputs)
        if trend is not Trend.NONE:
            centre = _mean(y)
            centres = np.array([_mean(column) for column in u.T])
            for i, column in enumerate(u.T):  # a constant one becomes zero, not the rounding of its mean
                known = column[np.isfinite(column)]
                centres[i] = known[0] if known.size and np.ptp(known) == 0.0 else centres[i]
        output, inputs = Signals(y - centre, u - centres).scales
        low = min(r.first for r in records)
        high = max(r.first + r.y.size for r in records)
        half = max((high - low) / 2, 1.0)
        return cls(orders, trend, sample_time, output, inputs, centre, centres, (low + high) / 2, half)

    @property
    def full_orders(self) -> Orders:
        """With an input for each of the trend's parameters, behind the others."""
        o, extra = self.orders, self.trend.value
        return Orders(o.na, (*o.nb, *[1] * extra), o.nc, (*o.nk, *[0] * extra))

    def augmented(self, record: Signals) -> Signals:
        """The recording in these coordinates."""
        time = (record.first + np.arange(float(record.y.size)) - self.middle) / self.half
        extra = [np.ones_like(time), time][: self.trend.value]
        u = (record.u - self.input_centres) / self.inputs
        return Signals(
            (record.y - self.output_centre) / self.output, np.ascontiguousarray(np.column_stack([u, *extra]))
        )

    def affine(self) -> tuple[Array, Array]:
        """M and m of [a, b, constant, slope, c] = M theta + m, theta being the parameters in these coordinates."""
        full = self.full_orders
        M, m = np.eye(full.parameters), np.zeros(full.parameters)
        blocks = list(full.blocks())
        for i, block in enumerate(blocks[: self.orders.inputs]):
            M[block, block] *= self.output / self.inputs[i]
        if self.trend is Trend.NONE:
            return M, m
        constant = blocks[self.orders.inputs].start
        M[constant, constant] = self.output
        M[constant, : self.orders.na] = m[constant] = self.output_centre
        for i, block in enumerate(blocks[: self.orders.inputs]):
            M[constant, block] = -self.input_centres[i] * self.output / self.inputs[i]
        if self.trend is Trend.LINEAR:
            M[constant, constant + 1] = -self.output * self.middle / self.half
            M[constant + 1, constant + 1] = self.output / (self.half * self.sample_time)
        return M, m

    def entered(self, theta: Array) -> Array:
        """[a, b, c] in the signals' units brought into these coordinates, the trend's parameters being zero."""
        out, o = np.zeros(self.full_orders.parameters), self.orders
        out[: o.na] = theta[: o.na]
        for i, block in enumerate(o.blocks()):
            out[block] = theta[block] * self.inputs[i] / self.output
        out[self.full_orders.c_block] = theta[o.c_block]
        return out

    def model(self, theta: Array, noise_variance: float, covariance: Array | None = None) -> Armax:
        """The model whose parameters are `theta` in these coordinates; so is `covariance`, `noise_variance` is not."""
        M, m = self.affine()
        values, spread = M @ theta + m, None
        own = np.r_[0 : self.orders.parameters - self.orders.nc, self.full_orders.c_block]
        extra = np.arange(self.trend.value) + self.orders.parameters - self.orders.nc
        errors = np.zeros(2)
        if covariance is not None:
            every = spread_of(M, covariance)
            spread = every[np.ix_(own, own)]
            errors[: extra.size] = np.sqrt(np.diag(every)[extra])
        trend = np.zeros(2)
        trend[: extra.size] = values[extra]
        return from_theta(
            values[own],
            self.orders,
            self.sample_time,
            noise_variance,
            spread,
            (trend[0], trend[1]),
            (errors[0], errors[1]),
        )


def spread_of(M: Array, covariance: Array) -> Array:
    """M covariance M', with infinite variances where M uses an entry of infinite variance."""
    open_ = ~np.isfinite(np.diag(covariance))
    finite = np.where(np.isfinite(covariance), covariance, 0.0)
    finite[open_] = 0.0
    finite[:, open_] = 0.0
    out: Array = M @ finite @ M.T
    touched = (np.abs(M) @ open_) > 0
    out[np.ix_(touched, touched)] = np.nan
    out[touched, touched] = np.inf
    return out


def _mean(x: Array) -> float:
    known = x[np.isfinite(x)]
    return float(np.mean(known)) if known.size else 0.0


def find_trend(records: Sequence[Signals], orders: Orders) -> Trend:
    """A constant always, a slope where the recordings show one.

    Detected by a long ARX regression, which has a unique minimum.
    """
    long = Orders(max(LONG, orders.na), tuple(max(LONG, nb) for nb in orders.nb), 0, orders.nk)
    frame = Frame.of(records, long, 1.0, Trend.LINEAR)
    full = frame.full_orders
    rows = [arx_rows(frame.augmented(record), full) for record in records]
    Phi, y = np.concatenate([r[0] for r in rows]), np.concatenate([r[1] for r in rows])
    if y.size < 3 * full.parameters:
        return Trend.CONSTANT
    R = triangle(np.column_stack([Phi, y]))  # the slope is the last regressor: its t value is in the corner
    explained, left = float(R[-2, -1] ** 2), float(R[-1, -1] ** 2)
    new = abs(float(R[-2, -2])) > 1e-9 * float(np.linalg.norm(Phi[:, -1]))
    strong = new and explained * (y.size - full.parameters) > SURE**2 * left
    return Trend.LINEAR if strong else Trend.CONSTANT
