"""The paper's Table 2 for any recording: real output, predicted output and error, for orders and horizons.

One estimator makes all rows of a table. Each row occurs twice: in sample, for models fitted to the whole recording,
and held out, for models of the same structure fitted to its first part and judged on the rest.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike

from optid.armax.model import Armax
from optid.armax.multistep import expected_error
from optid.armax.prediction import predict
from optid.armax.signals import Signals, signals
from optid.core.model import Array

if TYPE_CHECKING:
    import pandas as pd

# Column -> (its formula, and its unit in units of the output).
CAPTIONS: Final = {
    "order": ("na of the ARMAX model, eq. 12; 0: no model of this kind", ""),
    "steps": (
        "k: y(t) is predicted from outputs up to t - k and inputs up to t; residuals before the recording are "
        "estimated",
        "",
    ),
    "signal": ("real: y(t); predicted: yhat(t | t-k); error: e(t) = yhat(t | t-k) - y(t)", ""),
    "square_error": ("eq. 13 over the whole part: 1/2 sum of e(t)^2, t = 1..N", "2"),
    "mean_square_error": ("1/N sum of e(t)^2", "2"),
    "square_error_8": (
        "eq. 13 with N = 8, 4/N sum of (e(t) - mean e)^2: what the printed table seems to hold",
        "2",
    ),
    "sd": ("standard deviation: sqrt(1/(N-1) sum of (s(t) - mean s)^2) of the row's signal s", "1"),
    "max": ("largest s(t)", "1"),
    "min": ("smallest s(t)", "1"),
    "samples": ("N: samples with a prediction and a measured output", ""),
    "predictor": (
        "armax: the model fitted to one step; armax, k steps: fitted to this horizon, as the paper does; last value: "
        "yhat(t | t-k) = y(t-k)",
        "",
    ),
    "part": (
        "in sample: fitted to the whole recording and judged on it; held out: fitted to the first part, judged on the "
        "rest",
        "",
    ),
    "lag": (
        "samples by which the prediction comes late: where the mean of (yhat(t+L) - y(t))^2 is least",
        "",
    ),
    "expected_sd": ("the k-step error's standard deviation that A, C and the noise variance predict", "1"),
}
IN_SAMPLE, HELD_OUT = "in sample", "held out"
LAGGED_AT_MOST = 100_000  # samples in which the lag is searched


@dataclass(frozen=True)
class Entry:
    """One experiment: order, horizon, and predictor.

    Attributes:
        order: na.
        steps: horizon.
        model: fitted to the whole recording; None for a predictor other than an ARMAX model.
        held_out: of the same structure, fitted to the first part.
        predictor: as in the column.
        guesses: predictions of the whole recording by another predictor, in sample and held out, shapes (N,).
    """

    order: int
    steps: int
    model: Armax | None = None
    held_out: Armax | None = None
    predictor: str = "armax"
    guesses: tuple[Array, Array] | None = None

    def guess(self, record: Signals, held_out: bool) -> Array | None:
        """Its predictions of a recording, shape (N,); None where there are none of that kind."""
        if self.guesses is not None:
            return self.guesses[int(held_out)]
        model = self.held_out if held_out else self.model
        return None if model is None else predict(model, record.y, record.u, self.steps, estimated_start=True)


@dataclass(frozen=True)
class Table2:
    """The table and the data of its figures.

    Attributes:
        rows: three per experiment (real, predicted, error), columns as in `CAPTIONS`.
        unit: of the output.
        traces: for each experiment (order, steps) of the models fitted to one step its prediction, shape (N,).
        real: the output, shape (N,).
        sample_time: seconds.
        cut: first sample of the part held out; N where there is none.
    """

    rows: tuple[dict[str, object], ...]
    unit: str
    traces: dict[tuple[int, int], Array]
    real: Array
    sample_time: float
    cut: int

    def frame(self) -> pd.DataFrame:
        """The table with one row per experiment and signal."""
        import pandas as pd

        return pd.DataFrame(list(self.rows), columns=list(CAPTIONS))

    def errors(self, part: str = IN_SAMPLE) -> list[dict[str, object]]:
        """The error rows of a part."""
        return [row for row in self.rows if row["signal"] == "error" and row["part"] == part]

    def captions(self) -> dict[str, str]:
        """Each column's formula with its unit."""
        out = {}
        for column, (formula, power) in CAPTIONS.items():
            unit = {"": "", "1": f", {self.unit}", "2": f", {self.unit}²"}[power]
            out[column] = formula + unit
        return out

    def in_unit(self, unit: str, factor: float) -> Table2:
        """The same table in another unit, `factor` of which make one of this."""
        power = {"": 0, "1": 1, "2": 2}
        scale = {column: factor ** power[kind] for column, (_, kind) in CAPTIONS.items()}
        rows = tuple(
            {c: v * scale[c] if isinstance(v, float) else v for c, v in row.items()} for row in self.rows
        )
        traces = {key: factor * trace for key, trace in self.traces.items()}
        return Table2(rows, unit, traces, factor * self.real, self.sample_time, self.cut)

    def csv(self) -> str:
        """The table as CSV under comment lines with each column's formula."""
        captions = [f"# {column}: {formula}\n" for column, formula in self.captions().items()]
        return "".join(captions) + self.frame().to_csv(index=False)

    def time(self) -> Array:
        """Time of each sample, seconds, shape (N,)."""
        times: Array = np.arange(self.real.size, dtype=float) * self.sample_time
        return times


def table2(
    y: ArrayLike, u: ArrayLike | None, entries: Iterable[Entry], unit: str = "m", cut: int | None = None
) -> Table2:
    """Predict a recording with each model over its horizon and tabulate, in sample first.

    Args:
        y, u: the recording.
        entries: orders 3, 4, 5 at one step and order 4 at 1, 5, 10 steps in the paper.
        unit: of y, for the captions.
        cut: first sample of the part held out.
    """
    record, listed = signals(y, u), list(entries)
    end = record.y.size if cut is None else cut
    traces = {}
    rows: dict[str, list[dict[str, object]]] = {IN_SAMPLE: [], HELD_OUT: []}
    sample_time = next((entry.model.sample_time for entry in listed if entry.model is not None), 1.0)
    for entry in listed:
        for part, held_out, first in ((IN_SAMPLE, False, 0), (HELD_OUT, True, end)):
            guess = entry.guess(record, held_out) if first < record.y.size else None
            if guess is None:
                continue
            if part == IN_SAMPLE and entry.predictor == "armax":
                traces[entry.order, entry.steps] = guess
            rows[part] += _rows(entry, part, record.y[first:], guess[first:])
    return Table2((*rows[IN_SAMPLE], *rows[HELD_OUT]), unit, traces, record.y, sample_time, end)


def last_value(y: Array, steps: int) -> Array:
    """The prediction by the last known value, y(t - k), shape (N,)."""
    known = np.maximum.accumulate(np.where(np.isfinite(y), np.arange(y.size), 0))
    held = y[known]
    return np.concatenate([np.full(min(steps, y.size), np.nan), held[: max(y.size - steps, 0)]])


def _rows(entry: Entry, part: str, real: Array, guess: Array) -> list[dict[str, object]]:
    both = np.isfinite(guess) & np.isfinite(real)
    error = guess[both] - real[both]
    model = entry.held_out if part == HELD_OUT else entry.model
    known = model is not None and entry.guesses is None
    about = {"order": entry.order, "steps": entry.steps}
    closing: dict[str, object] = {"predictor": entry.predictor, "part": part}
    out = []
    for signal, values in (("real", real[both]), ("predicted", guess[both]), ("error", error)):
        shown = signal == "error"
        more: dict[str, object] = {
            "lag": lag_of(real, guess, entry.steps) if shown else math.nan,
            "expected_sd": expected_error(model, entry.steps) if shown and known and model else math.nan,
        }
        out.append(about | {"signal": signal} | _columns(signal, values) | closing | more)
    return out


def lag_of(real: Array, guess: Array, steps: int) -> float:
    """Lag of a prediction in samples, interpolated by a parabola around the smallest square error."""
    real, guess = real[:LAGGED_AT_MOST], guess[:LAGGED_AT_MOST]
    shifts = range(-2, steps + 3)
    errors = [_shifted(real, guess, shift) for shift in shifts]
    best = int(np.argmin(errors)) if np.all(np.isfinite(errors)) else 0
    if not 0 < best < len(errors) - 1:
        return math.nan
    before, here, after = errors[best - 1 : best + 2]
    bend = before - 2.0 * here + after
    return shifts[best] + (0.5 * (before - after) / bend if bend > 0.0 else 0.0)


def _shifted(real: Array, guess: Array, shift: int) -> float:
    N = real.size
    moved, still = guess[max(shift, 0) : N + min(shift, 0)], real[max(-shift, 0) : N - max(shift, 0)]
    with np.errstate(all="ignore"):
        squares = (moved - still) ** 2
    return float(np.nanmean(squares)) if np.isfinite(squares).any() else math.nan


def _columns(signal: str, s: Array) -> dict[str, object]:
    N, error = s.size, signal == "error"
    nan = float("nan")
    with np.errstate(over="ignore"):
        square = float(np.sum(s**2)) if error else nan
        return {
            "square_error": 0.5 * square,
            "mean_square_error": square / N if N else nan,
            "square_error_8": 4.0 * float(np.var(s)) if error and N else nan,
            "sd": float(np.std(s, ddof=1)) if N > 1 else nan,
            "max": float(np.max(s)) if N else nan,
            "min": float(np.min(s)) if N else nan,
            "samples": N,
        }
