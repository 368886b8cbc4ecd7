"""Recursive identification, one sample at a time in real time, or over a whole recording."""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Self, cast

import numpy as np
from numpy.typing import ArrayLike

from optid.armax import layout as at
from optid.armax.forgetting import Constant, Forgetting
from optid.armax.model import Armax, from_theta
from optid.armax.prediction import ahead
from optid.armax.signals import signals
from optid.armax.structure import Orders
from optid.core.model import Array
from optid.errors import InputError


class Method(enum.Enum):
    """The approximation of the innovation's gradient."""

    EXTENDED_LEAST_SQUARES = (
        "extended least squares: simple and quick, consistent where 1/C - 1/2 is positive real"
    )
    MAXIMUM_LIKELIHOOD = "recursive maximum likelihood: exact gradient, converges to the offline estimate"


NOISE = 0.01  # default sd of the innovation as a share of the output's scale


@dataclass(frozen=True)
class Settings:
    """Settings of the recursion.

    Attributes:
        method: of the gradient; without C both are recursive least squares.
        forgetting: law of forgetting.
        start_sd: prior sd of the coefficients of A and B of the scaled signals.
        start_sd_c: the same for C. A large value lets C diverge before A and B are known, so it is smaller.
        noise: expected standard deviation of the innovation as a share of the output's scale, on which P's
            start rests; None is 0.01 for an `Identifier` and a quick regression in `identify`.
        variance_limit: trace of P above which nothing is forgotten; None is the start's own trace.
        outliers: standard deviations of the innovation beyond which its step is bounded; None: no bound.
        warm: initial reduction of the forgetting factor, and the factor by which it decays; so early gradients,
            computed with a wrong C, are forgotten (Ljung and Söderström 1983, sec. 5.6). None is (0.05, 0.99) where
            there is a C and (0, 0) where there is none.
        ease: maximum likelihood starts with the gradient of extended least squares and changes to its own: C(q) is
            mixed with 1 by a share that decays by this factor per sample; None starts with its own.
        patience: updates per parameter before C is estimated. Innovations with wrong A and B are not noise; as
            regressors of C they would dominate the real noise of a quiet system.
        radius: the roots of C stay inside this circle.
        at_rest: whether the signals were zero before the first sample; otherwise updates start when all lags are
            measured.
    """

    method: Method = Method.MAXIMUM_LIKELIHOOD
    forgetting: Forgetting = field(default_factory=Constant)
    start_sd: float = 3.0
    start_sd_c: float = 0.3
    noise: float | None = None
    variance_limit: float | None = None
    outliers: float | None = None
    warm: tuple[float, float] | None = None
    ease: float | None = 0.998
    patience: float = 10.0
    radius: float = 0.995
    at_rest: bool = False

    def __post_init__(self) -> None:
        for name, value, low, high in (
            ("start_sd", self.start_sd, 1e-9, 1e9),
            ("start_sd_c", self.start_sd_c, 1e-9, 1e9),
            ("noise", NOISE if self.noise is None else self.noise, 1e-9, 1e3),
            ("variance_limit", 1.0 if self.variance_limit is None else self.variance_limit, 1e-12, 1e30),
            ("outliers", 3.0 if self.outliers is None else self.outliers, 0.1, 1e6),
            ("warm", 0.0 if self.warm is None else self.warm[0], 0.0, 0.5),
            ("warm", 0.0 if self.warm is None else self.warm[1], 0.0, 0.9999),
            ("ease", 0.0 if self.ease is None else self.ease, 0.0, 0.999999),
            ("patience", self.patience, 0.0, 1e6),
            ("radius", self.radius, 0.1, 1.0),
        ):
            if not low <= value <= high:
                raise InputError(f"{value}", field=name, expected=f"{low:g} to {high:g}")

    def start_variances(self, orders: Orders) -> Array:
        """The diagonal of P before the first sample, shape (parameters,)."""
        sd = np.full(orders.parameters, self.start_sd)
        sd[orders.c_block] = self.start_sd_c
        variances: Array = (sd / (NOISE if self.noise is None else self.noise)) ** 2
        return variances


@dataclass(frozen=True)
class Counts:
    """Counts of processed samples."""

    samples: int
    learnt_from: int
    missing: int
    outliers: int
    projections: int


class Identifier:
    """A recursive ARMAX identifier; its whole state is one array.

    Args:
        orders: of eq. 12.
        sample_time: seconds.
        settings: of the recursion.
        scales: usual sizes of the output and of each input, in the units `step` receives them in. With them the start
            variance and the limits are independent of units.
        tailored: compile for these orders alone. Takes seconds once (numba keeps the result on disk) and then
            about half the time a sample; the results are the same bits.
    """

    def __init__(
        self,
        orders: Orders,
        sample_time: float = 1.0,
        settings: Settings | None = None,
        scales: tuple[float, ArrayLike] | None = None,
        tailored: bool = False,
    ) -> None:
        self.orders, self.sample_time, self.settings = orders, float(sample_time), settings or Settings()
        output, inputs = (1.0, np.ones(orders.inputs)) if scales is None else scales
        self._state = fresh_state(
            orders, self.settings, float(output), np.atleast_1d(np.asarray(inputs, float))
        )
        self._ready(tailored)

    def _ready(self, tailored: bool) -> None:
        from optid.armax import recursion

        single = self.orders.inputs == 1
        step: Callable[..., float] = recursion.step_single if single else recursion.step_many
        run: Callable[..., None] = recursion.run
        if tailored:
            step, run = recursion.kernels(at.shape(self.orders))
        self._kernel, self._whole = cast("Callable[[Array, float, Any], float]", step), run
        # Compile (or load) now, on a copy: the first real-time sample must not wait for it.
        self._kernel(self._state.copy(), 0.0, 0.0 if single else np.zeros(self.orders.inputs))

    def step(self, y: float, u: Any = 0.0) -> float:
        """Update with one sample and return its innovation, the error of the one-step prediction.

        Args:
            y: output; NaN where it is missing.
            u: input, or an array of float64 with one entry for each input; NaN where it is missing.
        """
        return self._kernel(self._state, y, u)

    def run(self, y: ArrayLike, u: ArrayLike | None = None, every: int = 0) -> tuple[Array, Array]:
        """Process a whole recording with the same recursion.

        Returns:
            innovations, shape (N,), and theta after every `every` samples, shape (N // every, parameters).
        """
        record = signals(y, u)
        if record.u.shape[1] != self.orders.inputs:
            raise InputError(f"{record.u.shape[1]} inputs", field="u", expected=f"{self.orders.inputs}")
        innovations = np.empty(record.y.size)
        track = np.empty((record.y.size // every if every else 0, self.orders.parameters))
        self._whole(self._state, record.y, record.u, innovations, track, every)
        return innovations, track * self._unscale()

    def start_at(self, theta: ArrayLike) -> None:
        """Start from a parameter vector in the signals' units; C is stabilised.

        Args:
            theta: [a_1.., b.., c_1..], from a regression or an earlier model.
        """
        from optid.armax.stability import stabilise

        values = np.asarray(theta, dtype=float)
        if values.shape != (self.orders.parameters,) or not np.all(np.isfinite(values)):
            raise InputError("no finite vector", field="theta", expected=f"{self.orders.parameters} numbers")
        start, nc = at.theta_at(self.orders), self.orders.nc
        part = self._state[start : start + values.size]
        part[:] = values / self._unscale()
        stabilise(part[self.orders.c_block], nc, self.settings.radius, np.empty(2 * nc))
        self._state[at.PATIENCE] = 0.0

    # Estimates.

    @property
    def theta(self) -> Array:
        """The parameter vector [a_1.., b.., c_1..] in the signals' units."""
        return self._part(at.theta_at(self.orders), self.orders.parameters) * self._unscale()

    @property
    def covariance(self) -> Array:
        """Of `theta`: noise variance times P, shape (parameters, parameters)."""
        unscale = self._unscale()
        scaled: Array = np.outer(unscale, unscale) * self.scaled_covariance
        return scaled * max(self.noise_variance, 0.0) / float(self._state[at.SCALE]) ** 2

    @property
    def scaled_covariance(self) -> Array:
        """P of the scaled problem, shape (parameters, parameters); positive definite."""
        n, size = self.orders.parameters, at.stride(self.orders)
        D = self._part(at.diagonal_at(self.orders), n)
        U = self._part(at.triangle_at(self.orders), size * size).reshape(size, size).T[:n, :n]
        P: Array = (U * D) @ U.T
        return P

    @property
    def noise_variance(self) -> float:
        """Of e, in the output's unit squared; 0 before there are more samples than parameters."""
        updates, n = self._state[at.UPDATES], self.orders.parameters
        if updates <= n or self._state[at.WEIGHT] <= 0:
            return 0.0
        mean = self._state[at.SQUARES] / self._state[at.WEIGHT] * updates / (updates - n)
        return float(mean * self._state[at.SCALE] ** 2)

    @property
    def model(self) -> Armax:
        """The current estimate as a frozen model."""
        return from_theta(self.theta, self.orders, self.sample_time, self.noise_variance, self.covariance)

    @property
    def counts(self) -> Counts:
        """Counts of samples so far."""
        fields = (at.SAMPLES, at.UPDATES, at.MISSING, at.BOUNDED, at.PROJECTED)
        return Counts(*(int(self._state[i]) for i in fields))

    def predict(self, steps: int, u: ArrayLike | None = None) -> Array:
        """The next `steps` outputs, future noise being zero, shape (steps,).

        Args:
            steps: how many.
            u: the inputs of those samples, (steps,) or (steps, inputs); without them the last ones are held.
        """
        y, past, e = self._histories()
        future = np.repeat(past[-1:], steps, axis=0)
        if u is not None:
            future = np.asarray(u, dtype=float).reshape(-1, self.orders.inputs)
            if future.shape[0] != steps:
                raise InputError(f"{future.shape[0]} rows", field="u", expected=f"{steps}, one per step")
        return ahead(self.model, y, np.concatenate([past, future]), e, steps)

    # The memory.

    @property
    def state(self) -> Array:
        """A copy of the whole memory, from which `restored` continues exactly."""
        return self._state.copy()

    def restored(self, state: ArrayLike) -> Self:
        """An identifier with the same orders and settings that continues from a saved memory.

        Raises:
            InputError: the memory belongs to other orders or to another version.
        """
        memory = np.array(state, dtype=np.float64)
        expected = fresh_state(self.orders, self.settings, 1.0, np.ones(self.orders.inputs))
        fixed = [at.FORMAT, at.NA, at.NC, at.PARAMETERS, at.INPUTS]
        table = [at.table_at() + 3 * i + j for i in range(self.orders.inputs) for j in (0, 1)]
        if memory.shape != expected.shape or np.any(memory[fixed + table] != expected[fixed + table]):
            raise InputError(
                "the state of another model",
                field="state",
                expected=f"a state saved with orders {self.orders}",
            )
        other = object.__new__(type(self))
        other.orders, other.sample_time, other.settings = self.orders, self.sample_time, self.settings
        other._state = memory
        other._kernel, other._whole = self._kernel, self._whole
        return other

    def _part(self, start: int, length: int) -> Array:
        return self._state[start : start + length].copy()

    def _unscale(self) -> Array:
        factors = np.ones(self.orders.parameters)
        for i, block in enumerate(self.orders.blocks()):
            factors[block] = self._state[at.SCALE] * self._state[at.table_at() + 3 * i + 2]
        return factors

    def _histories(self) -> tuple[Array, Array, Array]:
        """Past outputs, inputs (oldest first; as many rows as the model reaches back) and residuals."""
        o, scale, places = self.orders, self._state[at.SCALE], at.places(self.orders)
        y = -self._part(places[at.OUTPUTS], o.na)[::-1] * scale
        e = self._part(places[at.RESIDUALS], o.nc)[::-1] * scale
        start = places[at.PAST_INPUTS]
        rows = max([1, *(nb + nk for nb, nk in zip(o.nb, o.nk, strict=True))])
        u = np.zeros((rows, o.inputs))
        for i, (nb, nk) in enumerate(zip(o.nb, o.nk, strict=True)):
            past = self._part(start, nb + nk)[::-1] / self._state[at.table_at() + 3 * i + 2]
            u[rows - past.size :, i] = past
            for t in range(1, rows):  # a lost command is assumed to hold
                if np.isnan(u[t, i]):
                    u[t, i] = u[t - 1, i]
            start += nb + nk + max(nb + nk, o.nc)
        return y, np.nan_to_num(u), e


def fresh_state(orders: Orders, settings: Settings, output_scale: float, input_scales: Array) -> Array:
    """The packed memory before the first sample; see `optid.armax.layout`."""
    if input_scales.size != orders.inputs:
        raise InputError(f"{input_scales.size} input scales", field="scales", expected=f"{orders.inputs}")
    if not (np.all(np.isfinite(input_scales)) and np.all(input_scales > 0) and 0 < output_scale < np.inf):
        raise InputError(f"{output_scale}, {input_scales}", field="scales", expected="positive sizes")
    n = orders.parameters
    s = np.zeros(at.size(orders))
    s[at.FORMAT] = at.CURRENT_FORMAT
    s[at.NA], s[at.NC], s[at.PARAMETERS], s[at.INPUTS] = orders.na, orders.nc, n, orders.inputs
    s[at.STRIDE] = at.stride(orders)
    for field_, start in at.places(orders).items():
        s[field_] = start
    s[at.FILTERED] = float(settings.method is Method.MAXIMUM_LIKELIHOOD and orders.nc > 0)
    settings.forgetting.write(s)
    s[at.FADE] = 1.0 / s[at.FACTOR]
    s[at.OUTLIER] = settings.outliers or 0.0
    variances = settings.start_variances(orders)
    s[at.LIMIT] = settings.variance_limit or float(np.sum(variances))
    s[at.RADIUS], s[at.SCALE] = settings.radius, output_scale
    warm = settings.warm if settings.warm is not None else ((0.05, 0.99) if orders.nc else (0.0, 0.0))
    s[at.WARM], s[at.WARM_RATE] = warm
    s[at.EASE], s[at.EASE_RATE] = (0.0, 0.0) if settings.ease is None else (1.0, settings.ease)
    s[at.PATIENCE] = settings.patience * n if orders.nc else 0
    s[at.HOLD] = 0.0 if settings.at_rest else orders.reach
    s[at.TRACE] = float(np.sum(variances))
    for i, (nb, nk) in enumerate(zip(orders.nb, orders.nk, strict=True)):
        s[at.table_at() + 3 * i : at.table_at() + 3 * i + 3] = nb, nk, 1.0 / input_scales[i]
    start, size = at.diagonal_at(orders), at.stride(orders)
    s[start : start + n] = variances
    start = at.triangle_at(orders)
    s[start : start + size * size] = np.eye(size).ravel()
    return s
