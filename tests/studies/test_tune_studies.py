"""The studies on tuning: their routes compute one and the same thing, and the real system keeps its limits."""

import numpy as np
import pytest

from optid.armax.model import Armax
from optid.pid.controller import Gains, Settings
from optid.tuning.plant import plant_of
from optid.tuning.scenarios import step
from optid.tuning.task import Task
from studies.benchmark_tune import LIMIT, SAMPLES, STEP, T, control_loop, scalar_loop

MODEL = Armax((1.0, -2.86, 2.745, -0.885), ((1e-6, 6e-6, 2e-6),), nk=(2,), sample_time=T)


@pytest.mark.parametrize("gains", [(60.0, 80.0, 0.6), (400.0, 4000.0, 5.0)])
def test_three_routes_one_cost(gains):
    """Plain Python, python-control and the compiled loop, inside the limits and far beyond."""
    task = Task((plant_of(MODEL),), (step(STEP, SAMPLES, T),), Settings(T, -LIMIT, LIMIT))
    lag = 2e-3
    compiled = task.closed_loop.costs(Gains(*gains, lag).vector)[0, 0]
    assert scalar_loop(MODEL, lag)(np.array(gains)) == pytest.approx(compiled, rel=1e-9)
    if gains[0] < 100:  # python-control takes its time
        assert control_loop(MODEL, lag)(np.array(gains)) == pytest.approx(compiled, rel=1e-6)


def test_the_real_system_answers():
    from studies.paper_gains import SETTINGS, profiles, real

    run = real(Gains(60.0, 50.0, 0.5, 2e-3), step(0.06, 300, T))
    assert abs(run.output[-1] - 0.06) < 2e-3
    assert np.abs(run.command).max() <= LIMIT
    steps = run.command / SETTINGS.resolution
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    assert profiles().reference[0] == 0.0
