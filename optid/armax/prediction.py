"""k-step prediction through the noise model, and simulation.

Given outputs up to t - k and inputs up to t, the best prediction of y(t) uses the known residuals through C(q) and
sets the unknown ones, e(t-k+1) .. e(t), to zero (Ljung, System Identification, 2nd ed. 1999, sec. 3.2). It is not the
one-step prediction repeated on measured outputs.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from optid.armax.gradient import carried, decay
from optid.armax.model import Armax
from optid.armax.signals import signals
from optid.core.jit_cache import kept
from optid.core.model import Array
from optid.errors import InputError, RecordingError

if TYPE_CHECKING:
    import pandas as pd


@kept(error_model="numpy", nogil=True)
def _driven(u, taps, delays, t):  # type: ignore[no-untyped-def]
    """Sum of B_i u_i at time t."""
    total = 0.0
    for i in range(taps.shape[0]):
        for k in range(taps.shape[1]):
            lag = t - delays[i] - k
            if taps[i, k] != 0.0 and lag >= 0:
                total += taps[i, k] * u[lag, i]
    return total


@kept(error_model="numpy", nogil=True)
def _innovate(y, u, a, taps, delays, c, reach, trend, e):  # type: ignore[no-untyped-def]
    """Residuals e of the one-step prediction, from those before `reach`; a missing output is replaced, in y, by its
    prediction."""
    drive = np.empty(y.size)
    for t in range(y.size):
        drive[t] = _driven(u, taps, delays, t) + trend[t]
        if t < reach:
            if math.isnan(y[t]):
                y[t] = y[t - 1] if t > 0 else 0.0
            continue
        guess = drive[t]
        for k in range(1, a.size):
            guess -= a[k] * y[t - k]
        for k in range(1, min(c.size, t + 1)):
            guess += c[k] * e[t - k]
        if math.isnan(y[t]):
            y[t], e[t] = guess, 0.0
        else:
            e[t] = y[t] - guess
    return drive


@kept(error_model="numpy", nogil=True)
def _roll(y, e, drive, a, c, reach, steps, out):  # type: ignore[no-untyped-def]
    """Fill out[t] with the prediction of y(t) made at t - steps."""
    na, nc = a.size - 1, c.size - 1
    window = np.empty(na + steps)
    for t in range(reach + steps - 1, y.size):
        first = t - steps + 1
        for k in range(na):
            window[k] = y[first - na + k]
        for s in range(steps):
            guess = drive[first + s]
            for k in range(1, na + 1):
                guess -= a[k] * window[na + s - k]
            for k in range(s + 1, nc + 1):
                if first + s - k >= 0:
                    guess += c[k] * e[first + s - k]
            window[na + s] = guess
        out[t] = window[na + steps - 1]


def _arrays(model: Armax) -> tuple[Array, Array, Array, Array]:
    width = max([len(b) for b in model.b] or [0])
    taps = np.zeros((len(model.b), width))
    for i, b in enumerate(model.b):
        taps[i, : len(b)] = b
    return np.array(model.a), taps, np.array(model.nk, dtype=np.int64), np.array(model.c)


def _prepare(model: Armax, y: ArrayLike, u: ArrayLike | None) -> tuple[Array, Array]:
    record = signals(y, u)
    if record.u.shape[1] != len(model.b):
        raise RecordingError(
            f"{record.u.shape[1]} inputs", field="u", expected=f"{len(model.b)}, the model's"
        )
    inputs = record.u.copy()
    for column in inputs.T:  # a lost command is assumed to hold
        lost = ~np.isfinite(column)
        if lost.any():
            last = np.maximum.accumulate(np.where(lost, 0, np.arange(column.size)))
            column[:] = np.where(np.isfinite(column[last]), column[last], 0.0)
    outputs = np.where(np.isfinite(record.y), record.y, np.nan)
    return outputs, inputs


def _start(model: Armax, outputs: Array, inputs: Array, trend: Array, estimated: bool) -> tuple[Array, int]:
    """Residuals before the first predictable sample, shape (N,), zero elsewhere; and its index."""
    e, nc, reach = np.zeros(outputs.size), model.orders.nc, model.orders.reach
    if not estimated or nc == 0:
        return e, reach
    a, taps, delays, c = _arrays(model)
    reach, length = max(reach, nc), decay(c[1:])
    some = slice(0, min(reach + length, outputs.size))
    found = np.zeros(some.stop)
    lost = np.isnan(outputs[some])
    _innovate(outputs[some].copy(), inputs[some], a, taps, delays, c, reach, trend[some], found)
    G = carried(c[1:], some.stop - reach) if some.stop > reach else np.zeros((0, nc))
    if G.size and np.all(np.isfinite(found)) and np.all(np.isfinite(G)) and not lost.any():
        e[reach - nc : reach] = np.linalg.solve(G.T @ G + np.eye(nc), -G.T @ found[reach:])[::-1]
    return e, reach


def innovations(
    model: Armax, y: ArrayLike, u: ArrayLike | None = None, first: int = 0, *, estimated_start: bool = False
) -> Array:
    """Errors of the model's one-step predictions, shape (N,); NaN before the first and where y is NaN.

    Args:
        model: that predicts.
        y, u: as in `predict`.
        first: number of earlier samples of the recording, for the model's trend.
        estimated_start: whether the residuals before the first are estimated, as in a fit; otherwise they are zero.
    """
    outputs, inputs = _prepare(model, y, u)
    lost = np.isnan(outputs)
    a, taps, delays, c = _arrays(model)
    trend = model.trend(outputs.size, first)
    e, reach = _start(model, outputs, inputs, trend, estimated_start)
    _innovate(outputs, inputs, a, taps, delays, c, reach, trend, e)
    e[:reach] = np.nan
    e[lost] = np.nan
    return e


def predict(
    model: Armax,
    y: ArrayLike,
    u: ArrayLike | None = None,
    steps: int = 1,
    first: int = 0,
    *,
    estimated_start: bool = False,
) -> Array:
    """Prediction of y(t) from outputs up to t - steps and inputs up to t, shape (N,); NaN before the first.

    Args:
        model: that predicts.
        y: output, shape (N,); NaN where missing (replaced by its prediction).
        u: inputs, shape (N,) or (N, inputs).
        steps: how far ahead.
        first: number of earlier samples of the recording.
        estimated_start: as for `innovations`.
    """
    if steps < 1 or int(steps) != steps:
        raise InputError(f"{steps}", field="steps", expected="a whole number of at least 1")
    outputs, inputs = _prepare(model, y, u)
    a, taps, delays, c = _arrays(model)
    out, trend = np.full(outputs.size, np.nan), model.trend(outputs.size, first)
    e, reach = _start(model, outputs, inputs, trend, estimated_start)
    drive = _innovate(outputs, inputs, a, taps, delays, c, reach, trend, e)
    _roll(outputs, e, drive, a, c, reach, int(steps), out)
    return out


def simulate(
    model: Armax, u: ArrayLike | None, start: ArrayLike = (), samples: int | None = None, since: int = 0
) -> Array:
    """Output without noise, shape (N,).

    Args:
        model: to simulate.
        u: inputs, shape (N,) or (N, inputs).
        start: the first outputs, from which it continues; zeros where there are fewer than the model needs.
        samples: length, if the model has no input.
        since: number of earlier samples of the recording.
    """
    first, lead = np.asarray(start, dtype=float), 0
    size = np.asarray(u).shape[0] if u is not None else (samples or first.size)
    y = np.full(size, np.nan)
    y[: first.size] = first[:size]
    if first.size == 0:
        lead = min(model.orders.reach, size)
        padded = np.concatenate([np.zeros((lead, len(model.b))), _prepare(model, y, u)[1]])
        outputs = np.concatenate([np.zeros(lead), y])
    else:
        outputs, padded = _prepare(model, y, u)
    a, taps, delays, c = _arrays(model)
    e, trend = np.zeros(outputs.size), model.trend(outputs.size, since - lead)
    _innovate(outputs, padded, a, taps, delays, c, model.orders.reach if first.size else lead, trend, e)
    return outputs[outputs.size - size :]


def ahead(model: Armax, y: Array, u: Array, e: Array, steps: int) -> Array:
    """The next `steps` outputs from past ones (oldest first), inputs up to the last step, past residuals."""
    a, taps, delays, c = _arrays(model)
    na, nc = a.size - 1, c.size - 1
    outputs, noise = np.concatenate([y, np.zeros(steps)]), np.concatenate([e, np.zeros(steps)])
    for s in range(steps):
        t = u.shape[0] - steps + s
        guess = _driven(u, taps, delays, t)
        guess -= sum(a[k] * outputs[y.size + s - k] for k in range(1, na + 1))
        guess += sum(c[k] * noise[e.size + s - k] for k in range(1, nc + 1))
        outputs[y.size + s] = guess
    return outputs[y.size :]


def fit_percent(y: ArrayLike, guess: ArrayLike) -> float:
    """100 (1 - |y - guess| / |y - mean y|) over samples where both exist."""
    y, guess = np.asarray(y, dtype=float), np.asarray(guess, dtype=float)
    both = np.isfinite(y) & np.isfinite(guess)
    if not both.any():
        return float("nan")
    spread = float(np.linalg.norm(y[both] - y[both].mean()))
    error = float(np.linalg.norm(y[both] - guess[both]))
    return 100.0 * (1.0 - error / spread) if spread > 0 else float("nan")


def prediction_frame(
    model: Armax, y: ArrayLike, u: ArrayLike | None, steps: tuple[int, ...] = (1, 5, 10)
) -> pd.DataFrame:
    """Measured output, each prediction and the simulation side by side, indexed by time in seconds."""
    import pandas as pd

    record = signals(y, u)
    columns = {"measured": record.y}
    columns |= {f"predicted_{k}": predict(model, y, u, k) for k in steps}
    start = np.nan_to_num(record.y[: max(1, model.orders.reach)])
    columns["simulated"] = simulate(model, u, start, record.y.size)
    index = pd.Index(np.arange(record.y.size) * model.sample_time, name="time")
    return pd.DataFrame(columns, index=index)
