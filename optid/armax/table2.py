"""The paper's Table 2 for any recording: real output, predicted output and error, for orders and horizons."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike

from optid.armax.model import Armax
from optid.armax.prediction import predict
from optid.armax.signals import signals
from optid.core.model import Array

if TYPE_CHECKING:
    import pandas as pd

# Column -> (what stands in it, as a formula, and its unit in units of the output).
CAPTIONS: Final = {
    "order": ("na = nb = nc of the ARMAX model, eq. 12", ""),
    "steps": ("k: y(t) is predicted from outputs up to t - k and inputs up to t", ""),
    "signal": ("real: y(t); predicted: yhat(t | t-k); error: e(t) = yhat(t | t-k) - y(t)", ""),
    "square_error": ("eq. 13 over the whole record: 1/2 sum of e(t)^2, t = 1..N", "2"),
    "mean_square_error": ("1/N sum of e(t)^2", "2"),
    "square_error_8": (
        "eq. 13 with N = 8, 4/N sum of (e(t) - mean e)^2: what the printed table seems to hold",
        "2",
    ),
    "sd": ("standard deviation: sqrt(1/(N-1) sum of (s(t) - mean s)^2) of the row's signal s", "1"),
    "max": ("largest s(t)", "1"),
    "min": ("smallest s(t)", "1"),
    "samples": ("N: samples with a prediction and a measured output", ""),
}


@dataclass(frozen=True)
class Entry:
    """Order and horizon of one experiment with its model."""

    order: int
    steps: int
    model: Armax


@dataclass(frozen=True)
class Table2:
    """The table and what its figures are drawn from.

    Attributes:
        rows: three per experiment (real, predicted, error), columns as in `CAPTIONS`.
        unit: of the output.
        traces: for each experiment (order, steps) its prediction, shape (N,).
        real: the output, shape (N,).
        sample_time: seconds.
    """

    rows: tuple[dict[str, object], ...]
    unit: str
    traces: dict[tuple[int, int], Array]
    real: Array
    sample_time: float

    def frame(self) -> pd.DataFrame:
        """The table with one row per experiment and signal."""
        import pandas as pd

        return pd.DataFrame(list(self.rows), columns=list(CAPTIONS))

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
        return Table2(rows, unit, traces, factor * self.real, self.sample_time)

    def csv(self) -> str:
        """The table as CSV under comment lines with each column's formula."""
        captions = [f"# {column}: {formula}\n" for column, formula in self.captions().items()]
        return "".join(captions) + self.frame().to_csv(index=False)

    def time(self) -> Array:
        """Time of each sample, seconds, shape (N,)."""
        times: Array = np.arange(self.real.size, dtype=float) * self.sample_time
        return times


def table2(y: ArrayLike, u: ArrayLike | None, entries: Iterable[Entry], unit: str = "m") -> Table2:
    """Predict a recording with each model over its horizon and tabulate.

    Args:
        y, u: the recording.
        entries: orders 3, 4, 5 at one step and order 4 at 1, 5, 10 steps in the paper.
        unit: of y, for the captions.
    """
    record = signals(y, u)
    rows: list[dict[str, object]] = []
    traces = {}
    sample_time = 1.0
    for entry in entries:
        guess = predict(entry.model, record.y, record.u, entry.steps)
        sample_time = entry.model.sample_time
        traces[entry.order, entry.steps] = guess
        both = np.isfinite(guess) & np.isfinite(record.y)
        error = guess[both] - record.y[both]
        for signal, values in (("real", record.y[both]), ("predicted", guess[both]), ("error", error)):
            rows.append(
                {"order": entry.order, "steps": entry.steps, "signal": signal} | _columns(signal, values)
            )
    return Table2(tuple(rows), unit, traces, record.y, sample_time)


def _columns(signal: str, s: Array) -> dict[str, object]:
    N, error = s.size, signal == "error"
    nan = float("nan")
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
