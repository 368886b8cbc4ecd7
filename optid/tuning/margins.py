"""Margins of the linear loop: how far its frequency response stays from the point of instability."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from optid.core.model import Array
from optid.errors import InputError
from optid.pid.pid_step import DERIVATIVE_FILTER, KD, KI, KP
from optid.tuning import nyquist
from optid.tuning.nyquist import DELAY, FIELDS, GAIN, MS, PHASE, STABLE
from optid.tuning.plant import Complex, Plant

COARSE, FINE = 240, 12_000  # number of frequencies during the search, and for the report
DECADES = 4.5  # below the Nyquist frequency


@dataclass(frozen=True)
class Margins:
    """Of a loop without its limits.

    Attributes:
        stable: all poles of the closed loop lie inside the unit circle.
        maximum_sensitivity: largest |1/(1 + L)|, Ms; its inverse is the smallest distance to the critical point.
        gain_margin: factor by which the gain may grow; infinite if any may.
        gain_reduction: factor to which it may shrink (below 1 for a model that needs the loop), else 0.
        phase_margin: degrees.
        delay_margin: s of additional delay up to instability.
        crossover: the highest angular frequency at which |L| = 1, rad/s; 0 for none.
    """

    stable: bool
    maximum_sensitivity: float
    gain_margin: float
    gain_reduction: float
    phase_margin: float
    delay_margin: float
    crossover: float


@dataclass(frozen=True)
class Required:
    """Required margins; None where there is no requirement. The linear loop must always be stable.

    Attributes:
        maximum_sensitivity: at most, more than 1.
        gain_margin: at least, a factor more than 1.
        phase_margin: at least, degrees, 0 to 180.
        delay_margin: at least, s.
    """

    maximum_sensitivity: float | None = None
    gain_margin: float | None = None
    phase_margin: float | None = None
    delay_margin: float | None = None

    def __post_init__(self) -> None:
        for name, least, most in (
            ("maximum_sensitivity", 1.0, math.inf),
            ("gain_margin", 1.0, math.inf),
            ("phase_margin", 0.0, 180.0),
            ("delay_margin", 0.0, math.inf),
        ):
            value = getattr(self, name)
            if value is not None and not least < value < most:
                more = f" and less than {most:g}" if math.isfinite(most) else ""
                raise InputError(f"{value:g}", field=name, expected=f"more than {least:g}{more}")

    @property
    def bounds(self) -> Array:
        """As `excess` takes them, shape (FIELDS,); infinite or 0 where nothing is asked."""
        ms, gain, phase, delay = (
            self.maximum_sensitivity,
            self.gain_margin,
            self.phase_margin,
            self.delay_margin,
        )
        return np.array([1.0, ms or math.inf, gain or 0.0, phase or 0.0, delay or 0.0])

    def kept(self, margins: Margins) -> bool:
        """Whether these margins meet the requirements."""
        b = self.bounds
        return bool(
            margins.stable
            and margins.maximum_sensitivity <= b[MS]
            and margins.gain_margin >= b[GAIN]
            and margins.phase_margin >= b[PHASE]
            and margins.delay_margin >= b[DELAY]
        )


@dataclass(frozen=True, eq=False)
class Frequencies:
    """The components of the loop's frequency response on a grid; arrays have shape (n,).

    Attributes:
        at: angular frequencies, rad per sample.
        plant: response of the plant.
        back: exp(-j at), a delay of one sample.
        sum: 1 / (1 - back), a running sum.
    """

    at: Array
    plant: Complex
    back: Complex
    sum: Complex

    @classmethod
    def of(cls, plant: Plant, count: int) -> Frequencies:
        """Logarithmic up to the Nyquist frequency, denser around the plant's resonances and near Nyquist."""
        log = np.geomspace(math.pi * 10**-DECADES, math.pi, count)
        even = np.linspace(math.pi / 40, math.pi, count // 4)
        near = [abs(math.atan2(p.imag, p.real)) for p in plant.poles if abs(p) > 0.5 and abs(p.imag) > 1e-6]
        width = np.geomspace(0.6, 1.6, count // 12)
        peaks = [w * width for w in near if w > 0.0]
        grid = np.unique(np.clip(np.concatenate([log, even, *peaks]), log[0], math.pi))
        back = np.exp(-1j * grid).astype(complex)
        return cls(grid, plant.response(grid), back, (1.0 / (1.0 - back)).astype(complex))

    @property
    def arrays(self) -> tuple[Array, Complex, Complex, Complex]:
        """As the compiled functions take them."""
        return self.at, self.plant, self.back, self.sum


def loop_response(plant: Plant, gains: Array, frequency: Array) -> Complex:
    """Loop gain L at angular frequencies, rad per sample."""
    return plant.response(frequency) * controller_response(gains, frequency, plant.sample_time)


def controller_response(gains: Array, frequency: Array, sample_time: float) -> Complex:
    """From the negative measurement to the command, as in `optid.pid.pid_step`, without limits."""
    back = np.exp(-1j * np.asarray(frequency))
    lag = gains[DERIVATIVE_FILTER]
    derivative = gains[KD] * (1.0 - back) / (lag + sample_time - lag * back)
    return np.asarray(gains[KP] + gains[KI] * sample_time / (1.0 - back) + derivative)


def margins(plant: Plant, gains: Array) -> Margins:
    """Margins on a fine grid, with extremes and crossings refined between its points."""
    grid = Frequencies.of(plant, FINE)
    found = np.empty(FIELDS + 2)
    nyquist.inspect(gains, plant.sample_time, plant.a, plant.b, True, *grid.arrays, found)
    if found[STABLE] < 1.0:
        return Margins(False, math.inf, 0.0, 0.0, 0.0, 0.0, float(found[FIELDS + 1]))
    return Margins(
        True,
        float(found[MS]),
        float(found[GAIN]),
        float(found[FIELDS]),
        float(found[PHASE]),
        float(found[DELAY]),
        float(found[FIELDS + 1]),
    )


def look(plant: Plant, grid: Frequencies, gains: Array) -> Array:
    """STABLE, MS, GAIN, PHASE, DELAY of one loop, shape (FIELDS,); an unstable one has no margin."""
    found = np.empty(FIELDS + 2)
    nyquist.inspect(gains, plant.sample_time, plant.a, plant.b, True, *grid.arrays, found)
    if found[STABLE] < 1.0:
        return np.array([0.0, 10.0 + found[MS], 0.0, 0.0, 0.0])
    return found[:FIELDS]


def excess(plant: Plant, grid: Frequencies, bounds: Array, gains: Array) -> Array:
    """Relative violation of the required margins by candidates (n, GAINS), shape (n,); 0 where all are kept.

    Unstable loops have at least 10.
    """
    out = np.empty(len(gains))
    nyquist.missed(
        np.ascontiguousarray(gains), plant.sample_time, plant.a, plant.b, *grid.arrays, bounds, out
    )
    return out
