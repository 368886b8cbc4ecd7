"""Several simulations of one axis judge together: the mean cost, the largest hunting, and each its own episodes."""

from dataclasses import replace

import numpy as np
import pytest

from optid.pid.controller import Settings
from optid.tuning.criterion import Criterion
from optid.tuning.joint_bench import JointBench
from optid.tuning.scenarios import step
from optid.tuning.sticking_axis import Mechanics, StickingAxis

T = 1e-3
SETTINGS, CRITERION = Settings(T, -5.0, 5.0), Criterion()
GAINS = np.array([[60.0, 0.0, 0.6, 2e-3, 1.0, 0.0], [20.0, 100.0, 0.1, 2e-3, 1.0, 0.0]])


def axis(dry, sizes):
    episodes = tuple(
        replace(step(size, 800, T, 1.0 / len(sizes)), run=run, rest=400) for run, size in enumerate(sizes)
    )
    return StickingAxis([Mechanics(gain=700.0, frequency=60.0, viscous=20.0, dry=dry)], episodes)


@pytest.fixture
def both():
    return axis(5.0, (0.06, -0.02)), axis(40.0, (0.03, 0.01, -0.05))


def judged(bench, **more):
    return bench.judged(GAINS, SETTINGS, CRITERION, 10.0, **more)


def test_the_cost_is_the_mean_and_the_hunting_the_largest(both):
    (one, swing), (other, other_swing) = (judged(bench) for bench in both)
    assert not np.allclose(one, other)
    cost, hunting = judged(JointBench(both))
    assert cost == pytest.approx((one + other) / 2)
    assert hunting == pytest.approx(np.maximum(swing, other_swing))


def test_some_episodes_are_those_of_each(both):
    joint = JointBench(both)
    assert len(joint.episodes) == 5
    assert sum(one.weight for one in joint.episodes) == pytest.approx(1.0)
    part = joint.only([1, 2, 4])
    assert [one.reference[-1] for one in part.episodes] == [-0.02, 0.03, -0.05]
    expected = (judged(both[0].only([1]))[0] + judged(both[1].only([0, 2]))[0]) / 2
    assert judged(part)[0] == pytest.approx(expected)
    assert judged(joint.only([3]))[0] == pytest.approx(judged(both[1].only([1]))[0] / 2)


def test_what_exceeds_its_bar_on_the_first_does_not_run_on_the_second(both):
    first = judged(both[0])[0]
    # The first candidate's bar lies below its cost on the first simulation alone, the second one's above everything.
    cost, _ = judged(JointBench(both), bar=np.array([first[0] / 4, np.inf]))
    assert cost[0] <= first[0] / 2 * (1 + 1e-12)
    assert cost[1] == pytest.approx(judged(JointBench(both))[0][1])
