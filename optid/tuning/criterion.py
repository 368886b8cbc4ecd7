"""The criterion of a tuning: ITAE and similar integrals, effort, overshoot, or a user's function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from optid.core.model import Array
from optid.errors import InputError
from optid.tuning.integral_criteria import Measure
from optid.tuning.response_metrics import Response

Own = Callable[[Array, Array, Array], float]


@dataclass(frozen=True)
class Criterion:
    """The minimised cost: measure x (1 + effort x travel + overshoot x overshoot), for each episode.

    Travel is the total variation of the command in units of its range, overshoot a share of the step; both weights are
    dimensionless, and at 0 only the measure counts.

    Attributes:
        measure: see there.
        effort: weight of the command's travel.
        overshoot: weight of the overshoot.
        own: instead of all that, a function of time (s), error and command, each of shape (samples,), whose value is
            minimised; slower, as Python runs once for each candidate.
    """

    measure: Measure = Measure.ITAE
    effort: float = 0.0
    overshoot: float = 0.0
    own: Own | None = None

    def __post_init__(self) -> None:
        for name in ("effort", "overshoot"):
            value = getattr(self, name)
            if not (value >= 0.0 and np.isfinite(value)):
                raise InputError(f"{value}", field=name, expected="a weight, not negative")

    def combined(self, parts: Array) -> Array:
        """Cost from parts (..., PARTS) of `optid.tuning.loop`; infinite where the loop diverged."""
        with np.errstate(invalid="ignore", over="ignore"):
            total = parts[..., 0] * (1.0 + self.effort * parts[..., 1] + self.overshoot * parts[..., 2])
        return np.where(np.isfinite(total), total, np.inf)

    def of(self, response: Response, sample_time: float, command_size: float) -> float:
        """Cost of one simulated episode, of any plant; infinite where it diverged."""
        if not response.bounded:
            return np.inf
        if self.own is not None:
            time: Array = sample_time * np.arange(float(response.output.size))
            value = float(self.own(time, response.episode.reference - response.output, response.command))
            return value if np.isfinite(value) else np.inf
        measure = response.measures[self.measure.name.lower()]
        return float(self.combined(np.array([measure, response.travel / command_size, response.overshoot])))
