"""A servo axis in small: an integrator behind a resonance, sampled; and the task of moving it by 6 cm."""

import numpy as np
import pytest
from scipy.signal import cont2discrete

from optid.armax.model import Armax
from optid.pid.controller import Settings
from optid.tune.demand import step
from optid.tune.plant import plant_of
from optid.tune.task import Task

T = 2e-3


def axis(gain=0.55, frequency=60.0, damping=0.4, delay=1, spread=None):
    """Speed gain (m/s per V), rad/s, damping ratio, delay in samples; `spread` is the coefficients' relative sd."""
    numerator = [gain * frequency**2]
    denominator = [1.0, 2 * damping * frequency, frequency**2, 0.0]
    b, a, _ = cont2discrete((numerator, denominator), T)
    b = b.ravel()[1:]
    covariance = None
    if spread:
        # Only the numerator is in doubt: the poles stay, the gain and its delay move.
        sd = np.r_[np.zeros(3), spread * np.abs(b)]
        covariance = tuple(map(tuple, np.diag(sd**2)))
    return Armax(tuple(a), (tuple(b),), (1.0,), (delay,), T, 1e-9, covariance)


@pytest.fixture(scope="session")
def model():
    return axis()


@pytest.fixture(scope="session")
def task(model):
    return Task((plant_of(model),), (step(0.06, 500, T),), Settings(T, -1, 1))
