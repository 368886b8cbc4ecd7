"""A second way to the parameters of the EMPS axis: inverse dynamics and linear least squares, no simulation.

    python studies/emps_inverse_dynamics.py [folder with DATA_EMPS.mat]

The motion equation is linear in its parameters once velocity and acceleration are known, so both are taken
from the measured position: Gautier's identification model, as Janot, Gautier and Brunot apply it to their
benchmark "Data Set and Reference Models of EMPS" (2019). A fit by simulation has to agree with what it finds.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import scipy.io
from numpy.typing import NDArray
from scipy.signal import butter, cheby1, filtfilt, sosfiltfilt

Array = NDArray[np.float64]
RECORDINGS = Path(__file__).parents[2] / "shared" / "recordings" / "emps"  # beside the checkout, never in it
DRIVE_GAIN = 35.15065188248547  # N/V, gtau of the benchmark

# Published by Janot, Gautier and Brunot (2019); offset in the sense of the plant `emps`.
PUBLISHED = {"M": 95.1089, "Fv": 203.5034, "Fc": 20.3935, "offset": -3.1648}
PUBLISHED_SEPARATE = {"M": 95.154, "Fv+": 166.706, "Fc+": 20.144, "Fv-": 240.424, "Fc-": 20.628}
UNITS = {"M": "kg", "Fv": "N s/m", "Fc": "N", "offset": "N"}


@dataclass(frozen=True)
class Settings:
    """Filters of the published estimate, which is reproduced in all printed digits with these.

    Attributes:
        cutoff: of the zero-phase Butterworth low-pass on position, Hz: five times the closed loop's 20 Hz.
        order: of that filter, before it runs forwards and backwards.
        decimation: samples kept one in this many, 0.8 * 500 Hz / (2 * 20 Hz), after a zero-phase Chebyshev
            filter (order 8, 0.05 dB) at 0.8 of the new Nyquist frequency on both sides of the equation.
        skip: first samples, where the filters swing in.
    """

    cutoff: float = 100.0
    order: int = 4
    decimation: int = 10
    skip: int = 49


@dataclass(frozen=True, eq=False)
class InverseDynamics:
    """The estimate: a table (parameter; value, sd, unit) and |force error| / |force|, both after decimation.

    `sd` takes the residuals for white, which they are not: a lower bound.
    """

    table: pd.DataFrame
    relative_error: float


def inverse_dynamics(
    t: Array,
    q: Array,
    u: Array,
    *,
    drive_gain: float = DRIVE_GAIN,
    separate: bool = False,
    settings: Settings | None = None,
) -> InverseDynamics:
    """Least squares of gtau u = M q'' + F_v q' + F_c sign(q') + offset.

    Args:
        t: time, s, evenly spaced, shape (n,).
        q: measured position, m, shape (n,).
        u: drive command, V, shape (n,).
        drive_gain: force per volt, N/V.
        separate: friction for each direction of motion on its own, and no offset.
        settings: filters.
    """
    s = settings or Settings()
    dt = float(t[-1] - t[0]) / (len(t) - 1)
    b, a = butter(s.order, 2 * s.cutoff * dt)
    smooth = filtfilt(b, a, q, padlen=3 * s.order)
    v = np.gradient(smooth, dt)
    acceleration = np.gradient(v, dt)
    if separate:
        forwards, backwards = v > 0, v < 0
        columns = {
            "M": acceleration,
            "Fv+": v * forwards,
            "Fc+": 1.0 * forwards,
            "Fv-": v * backwards,
            "Fc-": -1.0 * backwards,
        }
    else:
        columns = {"M": acceleration, "Fv": v, "Fc": np.sign(v), "offset": np.ones_like(v)}
    regressors = decimated(np.column_stack(list(columns.values()))[s.skip :], s.decimation)
    force = decimated(drive_gain * u[s.skip :], s.decimation)
    values, *_ = np.linalg.lstsq(regressors, force, rcond=None)
    error = force - regressors @ values
    spread = error.std(ddof=1) * np.sqrt(np.diag(np.linalg.inv(regressors.T @ regressors)))
    units = [UNITS[name.rstrip("+-")] for name in columns]
    table = pd.DataFrame(
        {"value": values, "sd": spread, "unit": units}, index=pd.Index(columns, name="parameter")
    )
    return InverseDynamics(table, float(np.linalg.norm(error) / np.linalg.norm(force)))


def decimated(signal: Array, keep: int) -> Array:
    """Every `keep`-th sample, the last one among them, after a zero-phase low-pass; along the first axis."""
    if keep == 1:
        return signal
    order = 8
    low_pass = cheby1(order, 0.05, 0.8 / keep, output="sos")
    filtered = sosfiltfilt(low_pass, signal, axis=0, padlen=3 * order)
    first = (len(signal) - 1) % keep
    return np.asarray(filtered[first::keep])


def read(path: Path) -> tuple[Array, Array, Array]:
    """Time (s), measured position (m) and command (V) of a recording of the benchmark."""
    variables = scipy.io.loadmat(path)
    t, q, u = (np.asarray(variables[name], float).ravel() for name in ("t", "qm", "vir"))
    return t, q, u


def main(arguments: Sequence[str] = ()) -> int:
    """Print both estimates beside the published ones; 1 if the recording is absent."""
    path = (Path(arguments[0]) if arguments else RECORDINGS) / "DATA_EMPS.mat"
    if not path.is_file():
        print(f"{path} is not there: fetch the EMPS benchmark (data/README.md) and name its folder")
        return 1
    t, q, u = read(path)
    for separate, published in ((False, PUBLISHED), (True, PUBLISHED_SEPARATE)):
        found = inverse_dynamics(t, q, u, separate=separate)
        table = found.table.assign(published=pd.Series(published))
        print(table.to_string(float_format=lambda number: f"{number:.4f}"))
        print(f"relative force error {100 * found.relative_error:.2f} %\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
