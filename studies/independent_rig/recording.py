"""From a run to the table that a data acquisition would write."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd

from studies.independent_rig.rig import Array, Run, Sensors


def recording(run: Run, rng: np.random.Generator, sensors: Sensors | None = None) -> pd.DataFrame:
    """The table a data acquisition would write: t (s), u (V), x, r (mm), pa, pb (bar absolute).

    Lost samples of the position are NaN; where the clocks drift apart the position is that of a later instant.
    """
    sensors = sensors or Sensors()
    x = run.measured
    if sensors.clock_drift != 0.0:
        late = np.interp(run.t * (1.0 + sensors.clock_drift), run.t, run.clean)
        x = grid(late + (run.measured - run.clean), sensors.quantum)
    if sensors.dropouts > 0.0:
        x = np.where(lost(len(x), sensors.dropouts, rng), np.nan, x)
    table = {"t": run.t, "u": run.command, "x": 1e3 * x, "r": 1e3 * run.reference}
    for name, pressure in (("pa", run.pressure_a), ("pb", run.pressure_b)):
        noise = sensors.pressure_noise * unit_noise(len(run.t), sensors.colour, rng)
        table[name] = (pressure + noise) / 1e5
    digits = {"t": 4, "u": 5, "x": 4, "r": 4, "pa": 5, "pb": 5}
    return pd.DataFrame(table).round(digits)


def grid(x: Array, quantum: float) -> Array:
    """Values on a converter's grid."""
    return np.asarray(quantum * np.round(x / quantum)) if quantum > 0.0 else x


def lost(n: int, share: float, rng: np.random.Generator, longest: int = 8) -> Array:
    """Which of n samples are lost: bursts of 1 to `longest`, `share` of all on average; never the first 50."""
    gone = np.zeros(n, dtype=bool)
    for _ in range(rng.poisson(share * n / ((1 + longest) / 2))):
        at = rng.integers(50, n)
        gone[at : at + rng.integers(1, longest + 1)] = True
    return gone


def unit_noise(n: int, colour: float, rng: np.random.Generator) -> Array:
    """Gaussian noise of variance 1 with autocorrelation colour**lag."""
    white = rng.normal(size=n)
    if colour == 0.0:
        return white
    noise = np.empty(n)
    noise[0] = white[0]
    for k in range(1, n):
        noise[k] = colour * noise[k - 1] + math.sqrt(1 - colour**2) * white[k]
    return noise
