"""Residuals of predictions and their autocorrelation, as reports show and judge them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from optid.core.model import Array

if TYPE_CHECKING:
    import pandas as pd

LAGS = 200  # samples


def residual(frame: pd.DataFrame, role: str, kind: str) -> Array:
    """Measured minus predicted, SI, shape (samples,); NaN where either is missing.

    Args:
        frame: a prediction's: NAME, NAME_free_run, NAME_window.
        role: NAME.
        kind: "free_run" or "window".
    """
    return np.asarray(frame[role] - frame[f"{role}_{kind}"], dtype=np.float64)


def autocorrelation(error: Array) -> tuple[Array, Array, float]:
    """Lags (samples, from 1), autocorrelation there, and the 95 % band of white noise.

    Missing samples count as zero, which shrinks the values a little.
    """
    known = np.isfinite(error)
    if known.sum() < 3:
        return np.empty(0), np.empty(0), 1.0
    centred = np.where(known, error - error[known].mean(), 0.0)
    power = np.abs(np.fft.rfft(centred, 2 * len(centred))) ** 2
    products = np.fft.irfft(power)[: min(LAGS, len(centred) - 1) + 1]
    band = 1.96 / float(np.sqrt(known.sum()))
    if products[0] <= 0:
        return np.empty(0), np.empty(0), band
    return np.arange(1.0, len(products)), products[1:] / products[0], band
