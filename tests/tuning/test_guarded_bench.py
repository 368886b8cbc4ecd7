"""A judge and a guard: the judge's cost, what hunting on the guard adds to it, and each its own episodes."""

from dataclasses import replace

import numpy as np
import pytest

from optid.pid.controller import Settings
from optid.tuning.criterion import Criterion
from optid.tuning.guarded_bench import GuardedBench
from optid.tuning.scenarios import step
from optid.tuning.sticking_axis import Mechanics, StickingAxis

T = 1e-3
SETTINGS, CRITERION = Settings(T, -5.0, 5.0), Criterion()
# The second ones have integral action, which makes an axis with much dry friction hunt.
GAINS = np.array([[60.0, 0.0, 0.6, 2e-3, 1.0, 0.0], [60.0, 3000.0, 0.6, 2e-3, 1.0, 0.0]])


def axis(dry, sizes):
    episodes = tuple(
        replace(step(size, 1500, T, 1.0 / len(sizes)), run=run, rest=700) for run, size in enumerate(sizes)
    )
    return StickingAxis([Mechanics(gain=700.0, frequency=60.0, viscous=20.0, dry=dry)], episodes)


@pytest.fixture
def both():
    return axis(2.0, (0.06, -0.02)), axis(40.0, (0.03, 0.01, -0.05))


def judged(bench, **more):
    return bench.judged(GAINS, SETTINGS, CRITERION, 10.0, **more)


def test_what_does_not_hunt_costs_what_the_judge_says(both):
    cost, hunting = judged(GuardedBench(*both))
    assert cost == pytest.approx(judged(both[0])[0])
    assert hunting == pytest.approx(np.maximum(judged(both[0])[1], judged(both[1])[1]))


def test_hunting_on_the_guard_is_added(both):
    swings = judged(both[1])[1]
    assert 3.0 * swings[0] < swings[1]
    rest = float(np.sqrt(swings[0] * swings[1]))
    mine, plain, hunted = judged(both[0], rest=rest)[0], judged(both[1])[0], judged(both[1], rest=rest)[0]
    cost, _ = judged(GuardedBench(*both), rest=rest)
    assert cost == pytest.approx(mine + hunted - plain)
    assert cost[0] == pytest.approx(mine[0])
    assert cost[1] > 1.5 * mine[1]


def test_some_episodes_are_those_of_each(both):
    guarded, rest = GuardedBench(*both), 1e-5
    part = guarded.only([1, 2, 4])
    assert [one.reference[-1] for one in part.episodes] == [-0.02, 0.03, -0.05]
    guard = both[1].only([0, 2])
    expected = judged(both[0].only([1]), rest=rest)[0] + judged(guard, rest=rest)[0] - judged(guard)[0]
    assert judged(part, rest=rest)[0] == pytest.approx(expected)


def test_what_exceeds_its_bar_with_the_judge_does_not_run_with_the_guard(both):
    rest = 1e-5
    alone = judged(both[0], rest=rest)[0]
    cost, _ = judged(GuardedBench(*both), rest=rest, bar=np.array([np.inf, alone[1] / 4]))
    assert cost[1] <= alone[1] * (1 + 1e-12)
    assert cost[0] == pytest.approx(judged(GuardedBench(*both), rest=rest)[0][0])
