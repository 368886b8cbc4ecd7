"""What a fit returns: frozen, in SI units, and plain about what it does not know."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from optid.core.model import Array

if TYPE_CHECKING:
    import pandas as pd


class Outcome(enum.Enum):
    """How a fit ended; the value is a sentence of advice."""

    CONVERGED = "The fit converged."
    TIME_LIMIT = "The time limit came first: the best point so far is kept; call again to go on from it."
    NOT_CONVERGED = (
        "The iteration did not settle: look at the certificate's unsound nodes, free fewer parameters or start "
        "nearer."
    )


@dataclass(frozen=True)
class Estimate:
    """A fitted parameter with its 95 % interval, SI units."""

    name: str
    unit: str
    value: float
    low: float
    high: float
    start: float
    at_bound: bool
    identifiable: bool


@dataclass(frozen=True)
class Score:
    """How close a prediction comes: 100 (1 - |y - yhat| / |y - mean y|), and the root mean square error."""

    fit_percent: float
    rmse: float
    unit: str

    @staticmethod
    def of(measured: Array, predicted: Array, unit: str) -> Score:
        """Score the samples that both have; NaN when there are none."""
        both = np.isfinite(measured) & np.isfinite(predicted)
        y, error = measured[both], (measured - predicted)[both]
        if not len(y):
            return Score(float("nan"), float("nan"), unit)
        spread = float(np.linalg.norm(y - y.mean()))
        fit = 100.0 * (1.0 - float(np.linalg.norm(error)) / spread) if spread > 0 else float("nan")
        return Score(fit, float(np.sqrt(np.mean(error**2))), unit)


@dataclass(frozen=True, eq=False)
class Certificate:
    """Convergence node by node: columns recording, time (s), defect (in process noise), misfit, sound."""

    frame: pd.DataFrame

    @property
    def sound(self) -> bool:
        """No node has an outlying defect or misfit."""
        return bool(self.frame["sound"].all())


@dataclass(frozen=True, eq=False)
class Fit:
    """A batch fit.

    Attributes:
        values: all parameters by name, fitted and stated, SI.
        covariance: of the fitted ones in the order of `parameters`.
        noise: role -> standard deviation of the residuals, SI.
        process_noise: what a node allowed in each state, SI.
        states: at the nodes, (windows, states).
        ties: sentences on parameters these data cannot tell apart.
    """

    outcome: Outcome
    parameters: tuple[Estimate, ...]
    values: Mapping[str, float]
    covariance: Array
    noise: Mapping[str, float]
    process_noise: Array
    states: Array
    ties: tuple[str, ...]
    certificate: Certificate
    seconds: float

    def frame(self) -> pd.DataFrame:
        """One row per fitted parameter."""
        import pandas as pd

        return pd.DataFrame([vars(e) for e in self.parameters]).set_index("name")
