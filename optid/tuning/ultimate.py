"""The ultimate gain and period of a plant: at which proportional control alone oscillates permanently."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from optid.tuning.margins import FINE, Frequencies
from optid.tuning.plant import Plant


@dataclass(frozen=True)
class Ultimate:
    """Gain (command per output, with its sign) and period (s); they scale all gains."""

    gain: float
    period: float


def ultimate(plant: Plant) -> Ultimate:
    """From the frequency response: the first crossing of the negative real axis with rising gain.

    A sampled model always has one, at the latest where the Nyquist frequency is.
    """
    grid = Frequencies.of(plant, FINE)
    response = plant.sign * grid.plant
    last, now = response[:-1], response[1:]
    turned = np.flatnonzero((last.imag >= 0.0) != (now.imag >= 0.0))
    share = last.imag[turned] / (last.imag[turned] - now.imag[turned])
    real = last.real[turned] + share * (now.real[turned] - last.real[turned])
    at = grid.at[turned] + share * (grid.at[turned + 1] - grid.at[turned])
    real, at = np.append(real, response[-1].real), np.append(at, math.pi)
    there = real < 0.0
    if not np.any(there):
        return Ultimate(plant.sign / float(np.abs(response).max()), 4.0 * plant.delay * plant.sample_time)
    first = int(np.argmin(np.where(there, real, 0.0)))
    return Ultimate(-plant.sign / float(real[first]), 2.0 * math.pi / float(at[first]) * plant.sample_time)
