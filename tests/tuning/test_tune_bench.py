"""The physical model in the loop: what is run is the rig's model, and tuning for it pays there."""

import math
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from optid.armax.model import Armax
from optid.core.simulation import simulate
from optid.errors import InputError
from optid.pid.controller import Controller, Gains, Settings
from optid.rigs.rigfile import read_rig
from optid.tuning.bench import Bench, PhysicalBench
from optid.tuning.bench_search import Effort
from optid.tuning.criterion import Criterion
from optid.tuning.optimise import Options, optimise
from optid.tuning.plant import plant_of
from optid.tuning.scenarios import load, step
from optid.tuning.task import Task


def axis_at(sample_time):
    """An integrator behind one lag: some axis."""
    gain, pole = 0.55, np.exp(-sample_time / 0.02)
    return Armax(
        (1.0, -1.0 - pole, pole), ((gain * (1 - pole) * sample_time,),), nk=(1,), sample_time=sample_time
    )


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
        assert cost == pytest.approx(run.measures["itae"] * (1 + run.overshoot), rel=2e-3)
        assert np.nanmax(np.abs(run.command)) <= 5.0


@pytest.mark.parametrize("gain", [1.0, 1.3])
def test_runs_together_cost_what_runs_alone_do(rig, gain):
    """Five episodes fill a group and a part of the next; a plant that answers more strongly has another cost."""
    noise = 3e-5 * np.random.default_rng(0).standard_normal(150)
    steps = (step(size, 150, T, 0.2) for size in (0.06, -0.04, 0.02, 0.01))
    every = (*(replace(one, noise=noise, rest=120, gain=gain) for one in steps), load(0.5, 150, T, 0.2))
    bench, vector = PhysicalBench(rig, every, tolerance=1e-5), GAINS.vector[None]
    together, one_by_one = (
        judged(bench, vector, LIMITS, Criterion(), 10.0) for judged in (PhysicalBench.judged, Bench.judged)
    )
    assert together[0] == pytest.approx(one_by_one[0], rel=3e-3)
    assert together[1] == pytest.approx(one_by_one[1], rel=2e-2)
    alone = PhysicalBench(rig, tuple(replace(e, gain=1.0) for e in every)).costs(
        vector, LIMITS, Criterion(), 10.0
    )
    assert (together[0] == pytest.approx(alone, rel=3e-3)) == (gain == 1.0)


def test_noise_reaches_the_controller_alone(rig):
    """With noise the command shivers; without gains nothing does, and the output is the true one."""
    still, shaken = (PhysicalBench(rig, (step(0.06, 150, T),), noise=noise) for noise in (0.0, 1e-4))
    [one], [two], [again] = still(GAINS, LIMITS), shaken(GAINS, LIMITS), shaken(GAINS, LIMITS)
    assert np.std(np.diff(two.command)) > np.std(np.diff(one.command))
    np.testing.assert_array_equal(two.command, again.command)
    [rest] = shaken(Gains(0.0), LIMITS)
    assert np.all(rest.command == 0.0) and np.std(np.diff(rest.output)) < 1e-6


def test_hopeless_gains_are_not_run(rig):
    """Gains whose cost on the identified model is beyond the bar never reach the physical one."""
    runs = []

    class Counted(PhysicalBench):
        def _together(self, *arguments):
            runs.append(arguments)
            return super()._together(*arguments)

    model = axis_at(T)
    task = Task((plant_of(model),), (step(0.06, 150, T),), LIMITS, bench=Counted(rig, (step(0.06, 150, T),)))
    both = np.array([GAINS.vector, Gains(1.0, derivative_filter=2e-3).vector])
    free = task.fitness(both)
    assert len(runs) == 2
    barred = task.fitness(both, np.array([np.inf, free[1] / 2]))
    assert len(runs) == 3
    assert barred[0] == free[0] and barred[1] > free[1] / 2


def test_time_that_is_up_ends_the_search_on_both_models(rig):
    """Only the first population of each search and the map of costs are still judged."""
    episodes = (step(0.06, 150, T),)
    task = Task((plant_of(axis_at(T)),), episodes, LIMITS, bench=PhysicalBench(rig, episodes))
    counts = []

    class Counted(Task):
        def fitness(self, vectors, bar=None):
            counts.append(len(np.atleast_2d(vectors)))
            return super().fitness(vectors, bar)

    counted = Counted(**{one.name: getattr(task, one.name) for one in fields(Task) if one.init})
    spent = Effort(over=lambda: sum(counts) > 100)
    found = optimise(counted, Options(starts=1, grid=3, effort=spent), np.random.default_rng(0))
    assert math.isfinite(task.fitness(found.gains.vector)[0])
    assert sum(counts) < 400, sum(counts)


def test_output_must_exist(rig):
    with pytest.raises(InputError, match="temperature"):
        PhysicalBench(rig, (step(0.06, 150, T),), "temperature")
