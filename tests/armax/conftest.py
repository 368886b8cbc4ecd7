"""Systems whose truth is known."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from optid.armax import Armax

sys.path.insert(0, str(Path(__file__).parents[2]))  # the studies are scripts beside the package

# The case of the issue "Recursive ARMAX, k-step prediction, Table 2": delay 11, noise variance 0.01.
TRUTH = Armax(
    a=(1.0, -2.21, 1.7494, -0.584256, 0.0684029),
    b=((1.5, -2.07, 1.3146),),
    c=(1.0, 0.3, 0.2),
    nk=(11,),
    noise_variance=0.01,
)


def record(model: Armax, N: int, seed: int, switch: float = 0.08) -> tuple[np.ndarray, np.ndarray]:
    """y and u of a model driven by a binary signal that switches with a probability, and by white noise."""
    rng = np.random.default_rng(seed)
    u = np.where(np.cumsum(rng.random((N, len(model.b))) < switch, axis=0) % 2, 1.0, -1.0)
    y = lfilter(model.c, model.a, np.sqrt(model.noise_variance) * rng.standard_normal(N))
    for i, (b, nk) in enumerate(zip(model.b, model.nk, strict=True)):
        y = y + lfilter(np.concatenate([np.zeros(nk), b]), model.a, u[:, i])
    return y, u


@pytest.fixture
def truth() -> Armax:
    return TRUTH


@pytest.fixture(scope="session")
def simulated() -> Callable[..., tuple[np.ndarray, np.ndarray]]:
    return record
