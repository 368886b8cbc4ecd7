"""The result of a fit: frozen, in SI units, with a statement of what it does not know."""

from __future__ import annotations

import enum
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtri

from optid.core.model import Array

if TYPE_CHECKING:
    import pandas as pd


CONFIDENCE = 0.95  # of every interval
Z95 = float(ndtri((1.0 + CONFIDENCE) / 2.0))  # its half-width, in sd


class Outcome(enum.Enum):
    """How a fit ended; the value is a sentence of advice."""

    CONVERGED = "The fit converged."
    TIME_LIMIT = (
        "The time limit was reached: the best point so far is kept; run the fit again to continue from it."
    )
    NOT_CONVERGED = (
        "The iteration did not converge: look at the unsound nodes in the report (Convergence, node by node), "
        "fit fewer parameters or start nearer."
    )
    BELOW_MEAN = (
        "The fit failed: it predicts worse than the mean of the measurement. Check signs, units and start "
        "values, and whether the command reached the axis."
    )
    AT_BOUNDS = (
        "The fit failed: every fitted parameter lies at a bound. Check signs, units and bounds: the data "
        "call for another model."
    )
    CONTRADICTION = (
        "The fit failed: its values contradict each other. Narrow the bounds, or state what is known."
    )

    @property
    def failed(self) -> bool:
        """Whether this fit must not be used."""
        return self not in (Outcome.CONVERGED, Outcome.TIME_LIMIT)


@dataclass(frozen=True)
class Estimate:
    """A fitted parameter with its 95 % interval, SI units; at a bound the interval is one-sided, infinite beyond it."""

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
    """Quality of a prediction: 100 (1 - |y - yhat| / |y - mean y|), and the root mean square error."""

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
        """Whether no node has an outlying defect or misfit."""
        return bool(self.frame["sound"].all())


@dataclass(frozen=True, eq=False)
class Fit:
    """A batch fit.

    Attributes:
        values: all parameters by name, fitted and stated, SI.
        covariance: of the fitted ones in the order of `parameters`.
        noise: role -> standard deviation of the residuals, SI.
        process_noise: sd of each state's jump at a node, SI.
        states: at the nodes, (windows, states).
        ties: sentences on parameters that these data cannot separate.
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

    def judged(self, stated: Collection[str], percents: Iterable[float | None], sound: bool = True) -> Fit:
        """The same fit, with its outcome corrected by the quality of its predictions.

        Args:
            stated: names of the parameters that were to be fitted.
            percents: fit of each channel whose error is more than its noise; ``None`` where there is none.
            sound: whether its values do not contradict each other.
        """
        at_bound = [e.at_bound for e in self.parameters if e.name in stated]
        outcome = self.outcome
        if any(percent is not None and percent < 0.0 for percent in percents):
            outcome = Outcome.BELOW_MEAN
        if at_bound and all(at_bound):
            outcome = Outcome.AT_BOUNDS
        if not sound:
            outcome = Outcome.CONTRADICTION
        return self if outcome is self.outcome else replace(self, outcome=outcome)
