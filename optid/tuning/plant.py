"""An identified discrete-time model for tuning: one command, one output, and remarks on its difficulties."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from optid.armax.model import Armax
from optid.core.model import Array
from optid.errors import InputError
from optid.pid.controller import Notch

Complex = NDArray[np.complex128]

MARGIN = 1e-9  # a pole this near to the unit circle counts as an integrator
DRIFT = 2e-3  # beyond 1: a real pole slower than 500 samples is an integrator with an estimation error
LEAST, MOST = 1e-20, 1e20  # of the largest coefficient: beyond it, squares of gains overflow
FREQUENCIES = 512  # frequencies at which a spectrum's lowest level is searched
NEGLIGIBLE = 1e-12  # of the largest coefficient: below it the model does not respond to its command


@dataclass(frozen=True, eq=False)
class Plant:
    """y(t) = -a_1 y(t-1) - ... + b_1 u(t-1) + b_2 u(t-2) + ...

    Attributes:
        a: a_1, a_2, ..., shape (order,).
        b: b_1, b_2, ..., shape (order,); padded with zeros as `a` is.
        sample_time: s.
        noise: largest sd of white sensor noise that is consistent with the model's disturbance, output's unit.
        remarks: what a user should know about the model, in sentences.
        dead_zone: (low, high), at most 0 and at least 0: commands between have no effect, command's unit. The linear
            loop, with its margins, is for commands beyond it.
    """

    a: Array
    b: Array
    sample_time: float
    noise: float = 0.0
    remarks: tuple[str, ...] = ()
    dead_zone: tuple[float, float] = (0.0, 0.0)

    @property
    def poles(self) -> Complex:
        """In z."""
        return np.roots(np.r_[1.0, self.a]).astype(complex)

    @property
    def zeros(self) -> Complex:
        """In z, those at the origin left out."""
        return np.roots(np.trim_zeros(self.b, "fb")).astype(complex)

    @property
    def sign(self) -> float:
        """Sign of the output's static response to a positive command; all gains of a controller have it."""
        return math.copysign(1.0, float(self.b.sum()))

    @property
    def static_gain(self) -> float:
        """Output per command at rest; infinite for an integrator."""
        denominator = 1.0 + float(self.a.sum())
        return float(self.b.sum()) / denominator if abs(denominator) > MARGIN else math.inf

    @property
    def delay(self) -> int:
        """Samples before the output responds, at least 1."""
        return int(np.flatnonzero(self.b)[0]) + 1

    def response(self, frequency: Array) -> Complex:
        """At angular frequencies, rad per sample, shape (n,)."""
        back = np.exp(-1j * np.asarray(frequency))
        powers = back[:, None] ** np.arange(1, len(self.a) + 1)
        return np.asarray((powers @ self.b) / (1.0 + powers @ self.a))

    def simulate(self, command: Array) -> Array:
        """Output from rest, shape of the command."""
        from scipy.signal import lfilter

        return np.asarray(lfilter(np.r_[0.0, self.b], np.r_[1.0, self.a], command))


def plant_of(model: Armax, input: int = 0, where: object = None) -> Plant:
    """One input's path of a model.

    Raises:
        InputError: no such input, or the output does not respond to it.
    """
    if not 0 <= input < len(model.b):
        raise InputError(f"{input}", where=where, field="input", expected=f"one of {len(model.b)}, from 0 on")
    delay, b = model.nk[input], np.array(model.b[input])
    remarks = []
    if delay == 0:
        delay = 1
        remarks.append(
            "The model responds in the sample of its command (nk = 0), which a loop cannot do: here the command "
            "acts one sample later."
        )
    largest = float(np.max(np.abs(b), initial=0.0))
    if abs(float(b.sum())) <= NEGLIGIBLE * b.size * largest:
        raise InputError(
            "zero static gain: the output does not respond to a constant command",
            where=where,
            field="b",
            hint="identify from a recording in which the command moves the output",
        )
    if not LEAST <= largest <= MOST:
        raise InputError(
            f"coefficients of {largest:g}",
            where=where,
            field="b",
            expected="coefficients of usual size; choose units that suit the signals",
        )
    order = max(len(model.a) - 1, delay - 1 + b.size)
    a = np.pad(np.array(model.a[1:]), (0, order - (len(model.a) - 1)))
    taps = np.pad(np.r_[np.zeros(delay - 1), b], (0, order - (delay - 1 + b.size)))
    plant = Plant(a, taps, model.sample_time, white_noise(model))
    return Plant(a, taps, plant.sample_time, plant.noise, (*remarks, *_difficulties(plant)))


def white_noise(model: Armax) -> float:
    """Sd of the white part of the disturbance C/A e, output's unit: the lowest level of its spectrum.

    White sensor noise raises the whole spectrum, so it cannot be larger than this. The prediction error also contains
    disturbances of the plant: on an axis with dry friction it is 1.4 to 1.5 times as large.
    """
    frequency = np.linspace(0.0, math.pi, FREQUENCIES + 1)[1:]
    back = np.exp(-1j * frequency)
    shaped = np.abs(np.polyval(model.c[::-1], back)) / np.maximum(
        np.abs(np.polyval(model.a[::-1], back)), LEAST
    )
    return math.sqrt(max(model.noise_variance, 0.0)) * float(shaped.min())


def behind(plant: Plant, notch: Notch | None) -> Plant:
    """A plant with a notch before its command, for the margins of the linear loop."""
    if notch is None:
        return plant
    b0, b1, b2, a1, a2 = notch.coefficients(plant.sample_time)
    a = np.convolve(np.r_[1.0, plant.a], (1.0, a1, a2))[1:]
    return replace(plant, a=a, b=np.convolve(plant.b, (b0, b1, b2)))


def _difficulties(plant: Plant) -> list[str]:
    """Properties of a plant that limit every controller."""
    said = []
    unstable = [p for p in plant.poles if abs(p) > 1.0 + MARGIN]
    for pole in unstable:
        if pole.imag < 0.0:
            continue
        grows = f"without control it grows by a factor e in {plant.sample_time / math.log(abs(pole)):.3g} s"
        if pole.imag == 0.0 and 0.0 < pole.real - 1.0 < DRIFT:
            said.append(
                f"The model drifts: {_said(pole)} is an integrator's pole slightly outside the unit circle; {grows}."
            )
            continue
        said.append(
            f"The model is unstable: pole {_said(pole)}; {grows}. The loop must stabilise it, and while the command "
            "is at a limit it runs away."
        )
    for zero in plant.zeros:
        if zero.real > 1.0 + 1e-6 and abs(zero.imag) < 1e-9 * abs(zero):
            speed = math.log(zero.real) / plant.sample_time
            if speed < math.pi / (5 * plant.sample_time):
                said.append(
                    f"The model is non-minimum-phase: because of its zero {zero.real:.6g} the output first goes "
                    f"the wrong way; no loop can be faster than about {speed / 2:.3g} rad/s."
                )
    return said


def _said(pole: complex) -> str:
    return f"{pole.real:.6g}" if pole.imag == 0.0 else f"{pole.real:.5g} ± {abs(pole.imag):.5g}i"


def scenarios(model: Armax, count: int, rng: np.random.Generator, input: int = 0) -> tuple[Plant, ...]:
    """Plants drawn from the model's own covariance, the model itself first.

    Args:
        model: identified, with its covariance.
        count: of plants, at least 1.
        rng: source of the draws.
        input: whose path.

    Raises:
        InputError: no covariance is known.
    """
    from optid.armax.model import from_theta

    nominal = plant_of(model, input)
    if count <= 1:
        return (nominal,)
    if model.covariance is None:
        raise InputError(
            "null",
            field="covariance",
            expected="the covariance of the coefficients",
            hint="identify again, or tune for the model alone (--scenarios 1)",
        )
    if not model.determined:
        raise InputError(
            "infinite",
            field="covariance",
            expected="coefficients that the data determine",
            hint="identify from a recording that excites the axis (armax.json says what is missing), or tune for the "
            "model alone",
        )
    spread = np.array(model.covariance)
    values, vectors = np.linalg.eigh((spread + spread.T) / 2)
    root = vectors * np.sqrt(np.clip(values, 0.0, None))
    draws = model.theta + rng.standard_normal((count - 1, len(root))) @ root.T
    return (
        nominal,
        *(
            plant_of(from_theta(theta, model.orders, model.sample_time, model.noise_variance), input)
            for theta in draws
        ),
    )
