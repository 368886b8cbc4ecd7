"""The physical model in the loop: what is run is the rig's model, and tuning for it pays there."""

from pathlib import Path

import numpy as np
import pytest

from optid.core.simulation import simulate
from optid.errors import InputError
from optid.pid.controller import Controller, Gains, Settings
from optid.rigs.rigfile import read_rig
from optid.tune.bench import PhysicalBench
from optid.tune.criterion import Criterion
from optid.tune.demand import load, step

DATA = Path(__file__).parents[2] / "data"
T = 1e-3
GAINS = Gains(60.0, 100.0, 0.6, 2e-3, 0.9)
LIMITS = Settings(T, -5, 5, rate=2000.0)


@pytest.fixture(scope="module")
def rig():
    return read_rig(DATA / "bench.toml")


@pytest.mark.parametrize("episode", [step(0.06, 150, T), load(0.5, 150, T)], ids=["step", "load"])
def test_bench_is_the_rigs_simulation(rig, episode):
    """Sample by sample through the public simulation, the command held between samples."""
    [run] = PhysicalBench(rig, (episode,))(GAINS, LIMITS)
    model = rig.model
    p = model.vector(rig.parameters)
    controller, x = Controller(GAINS, LIMITS), np.array(model.start(p)[0]).ravel()
    controller.reset(0.0, 0.0)
    seen, column = 0.0, [port.role for port in model.outputs].index("position")
    assert len(model.inputs) == 1
    for n in range(150):
        u = controller.step(float(episode.reference[n]), seen)
        assert run.output[n] == pytest.approx(seen, abs=2e-7)
        assert run.command[n] == pytest.approx(u, abs=2e-4)
        share = (u + episode.load[n]) / rig.channels["command"].per_unit
        result = simulate(model, p, x, np.array([T, T]), np.full((2, 1), share))
        x, seen = result.states[0, 1], float(result.outputs[0, 1, column])


def test_costs_are_those_of_the_runs(rig):
    bench = PhysicalBench(rig, (step(0.06, 150, T),))
    gains = np.array([GAINS.vector, Gains(16.0, 6.0, 0.001).vector, Gains(1e5, 1e6, 100.0).vector])
    costs = bench.costs(gains, LIMITS, Criterion(overshoot=1.0), 10.0)
    for vector, cost in zip(gains, costs, strict=True):
        [run] = bench(Gains(*vector), LIMITS)
        assert cost == pytest.approx(run.measures["itae"] * (1 + run.overshoot), rel=1e-9)
        assert np.nanmax(np.abs(run.command)) <= 5.0


def test_output_must_exist(rig):
    with pytest.raises(InputError, match="temperature"):
        PhysicalBench(rig, (step(0.06, 150, T),), "temperature")
