"""Tests of whether a model's held-out innovations still contain something that it should explain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from optid.core.model import Array, Model
from optid.core.recording import Recording
from optid.diagnosis.evaluation import Evaluation

LAGS = 20


@dataclass(frozen=True)
class ResidualTests:
    """Whiteness and independence of the input, with p-values; a correct model fails each at the rate `level`."""

    whiteness: float
    independence: float
    level: float

    @property
    def white(self) -> bool:
        """Whether they do not depend on their own past."""
        return self.whiteness >= self.level

    @property
    def independent(self) -> bool:
        """Whether they do not depend on past inputs."""
        return self.independence >= self.level


def residual_tests(
    evaluation: Evaluation, model: Model, recordings: Sequence[Recording], level: float
) -> ResidualTests:
    """Portmanteau tests on the scaled innovations of every output, pooled (Ljung and Box 1978)."""
    white, free, against, many = 0.0, 0, 0.0, 0
    for number, recording in enumerate(recordings):
        mine = evaluation.recording == number
        for j in range(evaluation.innovations.shape[1]):
            z = evaluation.innovations[mine, j]
            if np.isfinite(z).sum() < 10 * LAGS:
                continue
            z = np.clip(z - np.nanmean(z), -4.0, 4.0)
            white += _portmanteau(z, z)
            free += LAGS
            there = np.searchsorted(recording.time, evaluation.time[mine])
            for port in model.recorded:
                u = recording[port.role].values
                du = np.diff(u, prepend=u[0])[there]
                if np.nanstd(du) > 0:
                    against += _portmanteau(z, du - np.nanmean(du))
                    many += LAGS
    return ResidualTests(
        float(chdtrc(free, white)) if free else 1.0,
        float(chdtrc(many, against)) if many else 1.0,
        level,
    )


def _portmanteau(z: Array, w: Array) -> float:
    """Squared covariances of z with w 1..LAGS samples back, over their variances for these w, summed; NaN is missing.

    A sensor slower than the recording meets some steps of a command at some lags only.
    """
    variance, there = float(np.nanmean(z**2)), np.isfinite(z).astype(float)
    z, w, total = np.nan_to_num(z), np.nan_to_num(w), 0.0
    for k in range(1, LAGS + 1):
        scale = variance * float(there[k:] @ w[:-k] ** 2)
        if scale > 0.0:
            total += float(z[k:] @ w[:-k]) ** 2 / scale
    return total
