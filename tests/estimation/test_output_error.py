"""A fit without process noise ends where whole simulations from measured starts err least, however wrong the model."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from optid.estimation.multiple_shooting import FitOptions, fit
from optid.estimation.result import Outcome
from tests.estimation.cart import RATE, SD, moved, record, rig

SECONDS = 6.0


def creeping(rng):
    """A cart whose sensor creeps away by a hundred times its noise, which the model knows nothing of."""
    n = round(SECONDS * RATE)
    u = np.repeat(rng.uniform(-1.0, 1.0, n // 100 + 1), 100)[:n]
    x = moved(u, 1 / RATE) + 0.1 * (1 - np.exp(-20 * np.arange(n) / RATE))
    return u, x + SD * rng.standard_normal(n)


def simulated_best(u, x):
    """Gain, drag and first speed of the closed form that errs least from the first measured position."""
    return least_squares(lambda at: moved(u, 1 / RATE, x[0], at[2], at[0], at[1]) - x, (2.0, 1.0, 0.0)).x


def test_a_wrong_model_is_fitted_as_a_free_run_shows_it(tmp_path):
    """A free start would be put 0.1 m off to spare the model's later errors, and the gain would follow."""
    runs = [creeping(np.random.default_rng(seed)) for seed in (1, 2)]
    for u, x in runs:
        found = fit(rig(tmp_path), [record(u, x)], FitOptions(process_noise=0.0))
        gain, drag, _ = simulated_best(u, x)
        assert found.outcome is Outcome.CONVERGED
        assert found.values["gain"] == pytest.approx(gain, rel=1e-2)
        assert found.values["drag"] == pytest.approx(drag, rel=1e-2)
        assert abs(found.states[0, 0] - x[0]) < 0.03


def test_ends_of_windows_meet(tmp_path):
    u, x = creeping(np.random.default_rng(3))
    found = fit(rig(tmp_path), [record(u, x)], FitOptions(process_noise=0.0))
    assert found.certificate.frame["defect"].max() == 0.0
    path = moved(u, 1 / RATE, *found.states[0], found.values["gain"], found.values["drag"])
    begins = np.round(found.certificate.frame["time"] * RATE).astype(int)
    assert found.states[:, 0] == pytest.approx(path[begins], abs=1e-5)
