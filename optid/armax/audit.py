"""The audit of a discrete-time model: what it really contains."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from optid.armax.loop import Gains, Loop, close_loop
from optid.armax.model import Armax, from_transfer_function
from optid.armax.residuals import ResidualTests, residual_tests
from optid.armax.words import TWO_SIDED, Finding, findings
from optid.core.model import Array

if TYPE_CHECKING:
    from optid.armax.profile import Intervals

Roots = NDArray[np.complex128]

NEAR = 0.05  # a pole and a zero whose removal changes no frequency by more than this share cancel
NEAR_IN_NOISE = 0.2  # the same for a root of C, which is known less well
EMPTY = 0.01  # share of the impulse response's energy below which a pole carries nothing
CLOSE = 0.1  # and whose distance is at most this share of the pole's modulus
STATIC = 0.01  # share of the impulse response's energy outside its first sample that a static gain may have
SETTLED = 0.01  # share of the impulse response's peak
LONGEST = 100_000  # samples of impulse response examined


@dataclass(frozen=True)
class Cancellation:
    """A pole that a zero nearly cancels; `effect` is the largest relative change of response if both go."""

    pole: complex
    zero: complex
    effect: float

    @property
    def poles(self) -> int:
        """Number of poles removed: two for a complex pair."""
        return 2 if self.pole.imag else 1


@dataclass(frozen=True)
class NoiseCancellation:
    """A pole that a root of C nearly cancels, so that the noise does not excite it.

    `share` is the pole's own share of the impulse response's energy from the input: where that is zero as well, the
    pole is superfluous.
    """

    pole: complex
    root: complex
    share: float

    @property
    def empty(self) -> bool:
        """Whether neither noise nor input excites the pole."""
        return self.share < EMPTY


@dataclass(frozen=True)
class Audit:
    """The audit of one input's path of a model.

    Attributes:
        order: number of poles of the model.
        poles, zeros: in z.
        pole_errors: standard error of each pole's modulus, from the model's covariance; NaN where unknown.
        stable: every pole lies inside the unit circle.
        cancellations: poles a zero nearly cancels.
        noise_cancellations: poles a root of C nearly cancels.
        effective_order: poles that remain when those are gone.
        static_gain: response to a constant, infinite for an integrator; formal where the model is unstable.
        static_gain_error: its standard error, NaN where unknown, infinite where the data do not determine it.
        static_gain_interval: its 95 % interval, the same where unknown or open.
        first: first coefficient of the impulse response.
        static_share: share of the impulse response's energy in that sample (cancelled pairs removed).
        settles: samples until the impulse response stays below 1 % of its peak, None where it never does.
        time_constants: of the poles inside the unit circle, in samples, slowest first.
        residuals: tests on a recording, where one was given.
        loop: the loop closed with given gains, where some were given.
        findings: findings as sentences, alarms first.
    """

    order: int
    poles: tuple[complex, ...]
    zeros: tuple[complex, ...]
    pole_errors: tuple[float, ...]
    stable: bool
    cancellations: tuple[Cancellation, ...]
    noise_cancellations: tuple[NoiseCancellation, ...]
    effective_order: int
    static_gain: float
    static_gain_error: float
    static_gain_interval: tuple[float, float]
    first: float
    static_share: float
    settles: int | None
    time_constants: tuple[float, ...]
    residuals: ResidualTests | None
    loop: Loop | None
    findings: tuple[Finding, ...]

    @property
    def only_static(self) -> bool:
        """Whether the model is no more than a static gain with delay."""
        return self.static_share >= 1.0 - STATIC


def audit(
    model: Any,
    y: ArrayLike | None = None,
    u: ArrayLike | None = None,
    *,
    gains: Gains | None = None,
    input: int = 0,
    fitted: bool = True,
    error_rate: float = 0.01,
    intervals: Intervals | None = None,
) -> Audit:
    """Audit a discrete-time model.

    Args:
        model: `Armax`, a discrete `control.TransferFunction`, or (numerator, denominator) in powers of z.
        y, u: a recording to test its residuals on.
        gains: a PID controller to close its loop with.
        input: index of the input.
        fitted: whether the model was fitted to this recording.
        error_rate: at which a correct model's residuals fail a test.
        intervals: of its static gains, if they are better than those of the delta method.
    """
    if not isinstance(model, Armax):
        model = from_transfer_function(model)
    numerator, denominator = (np.trim_zeros(p, "b") for p in model.powers_of_z(input))
    poles = np.roots(denominator).astype(complex)
    zeros = np.roots(np.trim_zeros(numerator, "f")).astype(complex)
    pairs = cancellations(poles, zeros)
    gone = sum(pair.poles for pair in pairs)
    response = impulse_response(_reduced(model, pairs, input))
    energy = float(np.sum((response / max(np.max(np.abs(response)), 1e-300)) ** 2))
    peak = float(np.max(np.abs(response)))
    first = float(np.trim_zeros(np.array(model.b[input]), "f")[0]) if np.any(model.b[input]) else 0.0
    tests = None
    if y is not None:
        tests = residual_tests(model, y, u, error_rate=error_rate, fitted=fitted)
    inside = sorted((abs(p) for p in poles if 0.0 < abs(p) < 1.0), reverse=True)
    at_one = float(np.polyval(denominator, 1.0))
    gain = float(np.polyval(numerator, 1.0)) / at_one if abs(at_one) > 1e-12 else math.inf
    large = np.flatnonzero(np.abs(response) > SETTLED * peak)
    settles = int(large[-1]) + 1 if large.size and large[-1] + 1 < response.size else None
    result = Audit(
        order=int(poles.size),
        poles=tuple(complex(p) for p in poles),
        zeros=tuple(complex(z) for z in zeros),
        pole_errors=pole_errors(model, poles),
        stable=bool(np.all(np.abs(poles) < 1.0)),
        cancellations=pairs,
        noise_cancellations=noise_cancellations(model, poles, input),
        effective_order=int(poles.size) - gone,
        static_gain=gain,
        static_gain_error=static_gain_error(model, input),
        static_gain_interval=_gain_interval(model, gain, input)
        if intervals is None
        else intervals.static_gains[input],
        first=first,
        static_share=float((first / peak) ** 2 / energy) if peak > 0 else 0.0,
        settles=settles,
        time_constants=tuple(float(-1.0 / math.log(r)) for r in inside),
        residuals=tests,
        loop=None if gains is None else close_loop(model, gains, input),
        findings=(),
    )
    return _with_words(result)


def cancellations(poles: Roots, zeros: Roots, near: float = NEAR) -> tuple[Cancellation, ...]:
    """Pairs of a pole and a zero that nearly cancel, nearest first; a complex pole stands for its pair.

    Without both the response changes on the unit circle by at most |pole - zero| / |1 - |pole|| of itself.
    Near the origin all roots are close in that sense, so they must also lie within a tenth of the pole's modulus.
    """
    candidates = [
        Cancellation(complex(p), complex(z), float(abs(p - z) / max(abs(1.0 - abs(p)), 1e-12)))
        for p in poles
        for z in zeros
        if p.imag >= 0.0 and z.imag >= 0.0 and (p.imag > 0.0) == (z.imag > 0.0)
    ]
    taken: list[Cancellation] = []
    for pair in sorted(candidates, key=lambda c: c.effect):
        free = all(pair.pole != t.pole and pair.zero != t.zero for t in taken)
        if pair.effect <= near and free and abs(pair.pole - pair.zero) <= CLOSE * abs(pair.pole):
            taken.append(pair)
    return tuple(taken)


def noise_cancellations(model: Armax, poles: Roots, input: int = 0) -> tuple[NoiseCancellation, ...]:
    """Pairs of a pole and a root of C that nearly cancel in C/A, nearest first; a complex pole stands for two."""
    roots = np.roots(np.array(model.c)).astype(complex)
    found = []
    for pair in cancellations(poles, roots, NEAR_IN_NOISE):
        weight = 2.0 if pair.pole.imag else 1.0
        found.append(
            NoiseCancellation(pair.pole, pair.zero, weight * mode_share(model, poles, pair.pole, input))
        )
    return tuple(found)


def mode_share(model: Armax, poles: Roots, pole: complex, input: int = 0) -> float:
    """Energy of one pole's own mode in the impulse response of B/A, as a share of all modes' energies."""
    slope, n = np.polyder(np.array(model.a)), len(model.a) - 1
    energies = {}
    for p in poles:
        steepness = complex(np.polyval(slope, p))
        if abs(p) >= 1.0 or abs(p) < 1e-6 or steepness == 0.0:
            continue
        b = np.array(model.b[input])
        residue = complex(np.polyval(b, p)) * p ** (n - b.size) / steepness
        energies[complex(p)] = abs(residue) ** 2 / (1.0 - abs(p) ** 2)
    if complex(pole) not in energies or len(energies) < 2:
        return 1.0
    largest = max(sum(energies.values()), 1e-300)
    return float(energies[complex(pole)] / largest)


def pole_errors(model: Armax, poles: Roots) -> tuple[float, ...]:
    """Standard error of each pole's modulus to first order: dp/da_k = -p^(n-k) / A'(p), A in powers of z."""
    n = len(model.a) - 1
    if model.covariance is None or n == 0:
        return (math.nan,) * poles.size
    slope = np.polyder(np.array(model.a))
    errors = []
    for p in poles:
        steepness = complex(np.polyval(slope, p))
        if abs(p) == 0.0 or steepness == 0.0:
            errors.append(math.nan)
            continue
        change = np.array([-(p ** (n - k)) for k in range(1, n + 1)]) / steepness
        outwards = np.zeros(model.theta.size)
        outwards[:n] = np.real(change * np.conj(p)) / abs(p)
        errors.append(model.error_of(outwards))
    return tuple(errors)


def static_gain_error(model: Armax, input: int = 0) -> float:
    """Standard error of B(1)/A(1) to first order, NaN where it is unknown or there is no static gain."""
    at_one = float(np.sum(model.a))
    if model.covariance is None or abs(at_one) < 1e-12:
        return math.nan
    gradient = np.zeros(model.theta.size)
    gradient[: len(model.a) - 1] = -float(np.sum(model.b[input])) / at_one**2
    gradient[list(model.orders.blocks())[input]] = 1.0 / at_one
    return model.error_of(gradient)


def _gain_interval(model: Armax, gain: float, input: int) -> tuple[float, float]:
    margin = TWO_SIDED * static_gain_error(model, input)
    return gain - margin, gain + margin


def impulse_response(model: Armax, input: int = 0) -> Array:
    """The impulse response from its first non-zero sample until it has decayed, or up to a limit, shape (samples,)."""
    from scipy.signal import lfilter

    a = np.array(model.a)
    slowest = float(np.max(np.abs(np.roots(a)), initial=0.0))
    length = LONGEST
    if slowest < 1.0:
        length = min(LONGEST, int(30.0 / -math.log(slowest)) + 50) if slowest > 1e-9 else 50
    elif slowest > 1.0:
        length = min(LONGEST, int(50.0 / math.log(slowest)) + 2)
    pulse = np.zeros(length + len(model.b[input]) + len(a))
    pulse[0] = 1.0
    return np.asarray(lfilter(model.b[input], a, pulse))


def _reduced(model: Armax, pairs: Sequence[Cancellation], input: int) -> Armax:
    """The path of one input without its cancelled pairs, first coefficient and delay unchanged."""
    numerator, denominator = np.trim_zeros(np.array(model.b[input]), "f"), np.array(model.a)
    if not numerator.size:
        return Armax(a=model.a, b=(model.b[input],), nk=(0,))
    for pair in pairs:
        for polynomial, root in (("n", pair.zero), ("d", pair.pole)):
            factor = np.real(np.poly([root, np.conj(root)] if root.imag else [root]))
            if polynomial == "n":
                numerator = np.polydiv(numerator, factor)[0]
            else:
                denominator = np.polydiv(denominator, factor)[0]
    lead = denominator[0]
    return Armax(
        a=tuple(float(x) for x in denominator / lead), b=(tuple(float(x) for x in numerator / lead),), nk=(0,)
    )


def _with_words(result: Audit) -> Audit:
    return replace(result, findings=findings(result))
