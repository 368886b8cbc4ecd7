"""The hand-written C of this folder, compiled by gcc and called through ctypes."""

from __future__ import annotations

import ctypes
import functools
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from studies.peers.axis import FREE, TRUE, Array

HERE = Path(__file__).parent
# No -ffast-math: with -shared it sets flush-to-zero for the whole process. -fno-math-errno and
# -fno-trapping-math change no result; -Wno-psabi is for processors without AVX.
FLAGS = ("-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math", "-Wno-psabi", "-shared", "-fPIC")
_build = tempfile.TemporaryDirectory(prefix="axis-peer-")
_doubles = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")


def available() -> bool:
    """Whether a C compiler is installed."""
    return shutil.which("gcc") is not None


@functools.cache
def library(name: str) -> ctypes.CDLL:
    """Compile ``name.c`` once per process and load it."""
    target = Path(_build.name) / f"{name}.so"
    subprocess.run(["gcc", *FLAGS, str(HERE / f"{name}.c"), "-o", str(target), "-lm"], check=True)
    return ctypes.CDLL(str(target))


@dataclass(frozen=True)
class CFit:
    """Parameters (SI), sum of squared errors (m2), passes over the record, and whether the fit converged."""

    parameters: dict[str, float]
    cost: float
    passes: int
    converged: bool


def vector(p: Mapping[str, float]) -> Array:
    """Parameters in the order of axis.h."""
    return np.array([p[name] for name in TRUE])


def fit(
    p: Mapping[str, float],
    start: Sequence[float],
    commands: Array,
    positions: Array,
    dt: float,
    *,
    steps: int = 2,
    tolerance: float = 1e-8,
    most: int = 100,
) -> CFit:
    """Levenberg-Marquardt on `FREE` from the values in `p`.

    Args:
        p: parameters, SI; the free ones are start values.
        start: x, v, P_a, P_b at the first sample.
        commands: held commands as shares of full scale, shape (n,).
        positions: measured positions, m, shape (n,).
        dt: sample time, s.
        steps: Runge-Kutta steps in a sample.
        tolerance: relative decrease of the sum of squares that the last step may still promise. With 10 000
            samples 1e-8 is a hundredth of a standard deviation of the parameters.
        most: passes over the record.
    """
    run = library("fit_c").fit
    run.argtypes = [_doubles] * 4 + [
        ctypes.c_int,
        ctypes.c_double,
        ctypes.c_int,
        ctypes.c_double,
        ctypes.c_int,
        ctypes.POINTER(ctypes.c_double),
    ]
    run.restype = ctypes.c_int
    values, cost = vector(p), ctypes.c_double()
    u, y = np.ascontiguousarray(commands, float), np.ascontiguousarray(positions, float)
    x0 = np.array(start, float)
    passes = run(values, x0, u, y, len(u), dt, steps, tolerance, most, ctypes.byref(cost))
    names = list(TRUE)
    fitted = {name: float(values[names.index(name)]) for name in FREE}
    return CFit({**p, **fitted}, cost.value, abs(passes), passes > 0)


def simulate(
    p: Mapping[str, float], start: Sequence[float], commands: Array, dt: float, steps: int = 2
) -> Array:
    """States x, v, P_a, P_b at the samples, shape (n + 1, 4), by Runge-Kutta steps of dt/steps."""
    run = library("simulate_c").simulate
    run.argtypes = [_doubles, _doubles, _doubles, ctypes.c_int, ctypes.c_double, ctypes.c_int, _doubles]
    run.restype = None
    u = np.ascontiguousarray(commands, float)
    states = np.empty((len(u) + 1, 4))
    run(vector(p), np.array(start, float), u, len(u), dt, steps, states)
    return states
