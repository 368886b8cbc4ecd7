"""The ARMAX model of eq. 12, frozen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from optid.armax.structure import Orders
from optid.core.model import Array
from optid.errors import InputError

if TYPE_CHECKING:
    import control


@dataclass(frozen=True)
class Armax:
    """A(q) y(t) = sum_i B_i(q) u_i(t - nk_i) + constant + slope t + C(q) e(t): eq. 12 around an operating point.

    Attributes:
        a: coefficients of A from q^0 on; a[0] is 1.
        b: for each input its coefficients, the first one at delay nk.
        c: coefficients of C from q^0 on; c[0] is 1.
        nk: delay of each input, samples.
        sample_time: seconds.
        noise_variance: of e, in the output's unit squared.
        covariance: of [a_1.., b.., c_1..], shape (parameters, parameters), where known. Undetermined coefficients have
            infinite variance and no covariance (NaN) with each other.
        constant: constant term on the right side, output's unit; the printed eq. 12 has none.
        slope: its increase per second, counted from the recording's first sample.
        trend_errors: standard errors of `constant` and `slope`, 0 for what was not estimated.
    """

    a: tuple[float, ...]
    b: tuple[tuple[float, ...], ...] = ()
    c: tuple[float, ...] = (1.0,)
    nk: tuple[int, ...] = ()
    sample_time: float = 1.0
    noise_variance: float = 0.0
    covariance: tuple[tuple[float, ...], ...] | None = None
    constant: float = 0.0
    slope: float = 0.0
    trend_errors: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if len(self.b) != len(self.nk):
            raise InputError(f"{len(self.b)} polynomials B and {len(self.nk)} delays", field="b, nk")
        for name, polynomial in (("a", self.a), ("c", self.c)):
            if not polynomial or polynomial[0] != 1.0:
                raise InputError(
                    "does not begin with 1",
                    field=name,
                    hint="divide all polynomials by their first coefficient",
                )
        numbers = [*self.a, *self.c, *(x for b in self.b for x in b), self.noise_variance]
        numbers += [self.constant, self.slope]
        if not np.all(np.isfinite(numbers)):
            raise InputError("a coefficient is not finite", field="a, b, c")
        if not self.sample_time > 0:
            raise InputError(f"{self.sample_time}", field="sample_time", expected="seconds, more than 0")

    @property
    def orders(self) -> Orders:
        """Orders and delays."""
        return Orders(len(self.a) - 1, tuple(len(b) for b in self.b), len(self.c) - 1, self.nk)

    @cached_property
    def theta(self) -> Array:
        """The parameter vector [a_1.., b.., c_1..], shape (parameters,)."""
        return np.array([*self.a[1:], *(x for b in self.b for x in b), *self.c[1:]])

    @property
    def standard_errors(self) -> Array:
        """Standard deviation of each entry of `theta`, NaN where unknown."""
        if self.covariance is None:
            return np.full(self.theta.size, np.nan)
        errors: Array = np.sqrt(np.clip(np.diag(np.array(self.covariance)), 0.0, None))
        return errors

    @property
    def determined(self) -> bool:
        """Whether the data determine every coefficient, according to the covariance."""
        return bool(np.all(np.isfinite(self.standard_errors))) or self.covariance is None

    def error_of(self, gradient: Array) -> float:
        """First-order standard error of a function with this gradient to `theta`; infinite if undetermined."""
        if self.covariance is None:
            return math.nan
        weight = np.abs(gradient)
        told = np.isfinite(self.standard_errors)
        if np.any(weight[~told] > 1e-9 * float(np.max(weight, initial=1e-300))):
            return math.inf
        spread = np.array(self.covariance)[np.ix_(told, told)]
        return float(np.sqrt(max(gradient[told] @ spread @ gradient[told], 0.0)))

    def trend(self, samples: int, first: int = 0) -> Array:
        """constant + slope t over some samples after `first` earlier ones, shape (samples,)."""
        times: Array = self.sample_time * (first + np.arange(float(samples)))
        return self.constant + self.slope * times

    def transfer_function(self, input: int = 0) -> control.TransferFunction:
        """B/A of one input with its sample time, in powers of z."""
        import control

        numerator, denominator = self.powers_of_z(input)
        return control.TransferFunction(numerator, denominator, self.sample_time)

    def noise_transfer_function(self) -> control.TransferFunction:
        """C/A, which shapes e into the output's noise."""
        import control

        order = max(len(self.a), len(self.c))
        numerator = np.pad(self.c, (0, order - len(self.c)))
        denominator = np.pad(self.a, (0, order - len(self.a)))
        return control.TransferFunction(numerator, denominator, self.sample_time)

    def state_space(self) -> control.StateSpace:
        """All inputs to the output with one shared set of states (observer form)."""
        import control

        A, B, C, D = self.matrices()
        return control.StateSpace(A, B, C, D, self.sample_time)

    def matrices(self) -> tuple[Array, Array, Array, Array]:
        """A, B, C, D of the observer form, whose states are the remaining contributions of past samples."""
        taps = [np.concatenate([np.zeros(nk), b]) for b, nk in zip(self.b, self.nk, strict=True)]
        order = max([len(self.a) - 1, *(len(tap) - 1 for tap in taps), 1])
        a = np.pad(np.array(self.a), (0, order + 1 - len(self.a)))
        A = np.zeros((order, order))
        A[:, 0] = -a[1:]
        A[:-1, 1:] = np.eye(order - 1)
        b = np.column_stack(
            [np.pad(tap, (0, order + 1 - tap.size)) for tap in taps] or [np.zeros((order + 1, 0))]
        )
        C = np.eye(1, order)
        return A, b[1:] - np.outer(a[1:], b[0]), C, b[:1]

    def powers_of_z(self, input: int = 0) -> tuple[Array, Array]:
        """Numerator and denominator of B/A as polynomials in z, highest power first."""
        if not 0 <= input < len(self.b):
            raise InputError(f"{input}", field="input", expected=f"0 to {len(self.b) - 1}")
        tap = np.concatenate([np.zeros(self.nk[input]), self.b[input]])
        order = max(tap.size, len(self.a))
        return np.pad(tap, (0, order - tap.size)), np.pad(np.array(self.a), (0, order - len(self.a)))

    def __str__(self) -> str:
        def polynomial(name: str, coefficients: Sequence[float]) -> str:
            return f"{name} = [{', '.join(f'{x:.6g}' for x in coefficients)}]"

        inputs = [
            polynomial(f"B{i + 1 if len(self.b) > 1 else ''}", b) + f" from delay {nk}"
            for i, (b, nk) in enumerate(zip(self.b, self.nk, strict=True))
        ]
        parts = [polynomial("A", self.a), *inputs, polynomial("C", self.c)]
        if self.constant or self.slope:
            grows = f" {'+' if self.slope > 0 else '-'} {abs(self.slope):.6g} t" if self.slope else ""
            parts.append(f"constant {self.constant:.6g}{grows}")
        return f"{'; '.join(parts)}; every {self.sample_time:g} s, noise variance {self.noise_variance:.3g}"


def from_theta(
    theta: Array,
    orders: Orders,
    sample_time: float = 1.0,
    noise_variance: float = 0.0,
    covariance: Array | None = None,
    trend: tuple[float, float] = (0.0, 0.0),
    trend_errors: tuple[float, float] = (0.0, 0.0),
) -> Armax:
    """The model whose parameter vector is `theta`; `trend` is its constant and its slope."""
    values = [float(x) for x in theta]
    rows = None if covariance is None else tuple(tuple(float(x) for x in row) for row in covariance)
    return Armax(
        a=(1.0, *values[: orders.na]),
        b=tuple(tuple(values[block]) for block in orders.blocks()),
        c=(1.0, *values[orders.c_block]),
        nk=orders.nk,
        sample_time=float(sample_time),
        noise_variance=float(noise_variance),
        covariance=rows,
        constant=float(trend[0]),
        slope=float(trend[1]),
        trend_errors=(float(trend_errors[0]), float(trend_errors[1])),
    )


def from_transfer_function(system: Any, sample_time: float | None = None) -> Armax:
    """The model of a discrete `control.TransferFunction` or a pair (numerator, denominator) in powers of z.

    Raises:
        InputError: a continuous, improper or empty system.
    """
    if isinstance(system, tuple):
        numerator, denominator = (np.atleast_1d(np.asarray(p, dtype=float)) for p in system)
        dt: Any = sample_time
    else:
        if getattr(system, "ninputs", 1) != 1 or getattr(system, "noutputs", 1) != 1:
            raise InputError(
                "several inputs or outputs", field="transfer function", hint="pass them one by one"
            )
        numerator, denominator = np.asarray(system.num[0][0]), np.asarray(system.den[0][0])
        dt = system.dt if sample_time is None else sample_time
        if system.dt == 0:
            raise InputError(
                "continuous", field="transfer function", expected="a discrete-time one, with sample time"
            )
    if dt is None or dt is True:
        dt = 1.0
    numerator, denominator = np.trim_zeros(numerator, "f"), np.trim_zeros(denominator, "f")
    if not denominator.size or not numerator.size:
        raise InputError("a polynomial is zero", field="transfer function")
    delay = denominator.size - numerator.size
    if delay < 0:
        raise InputError("more zeros than poles", field="transfer function", expected="a causal model")
    lead = denominator[0]
    return Armax(
        a=tuple(float(x) for x in denominator / lead),
        b=(tuple(float(x) for x in numerator / lead),),
        nk=(delay,),
        sample_time=float(dt),
    )
