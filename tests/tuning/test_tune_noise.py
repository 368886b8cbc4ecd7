"""What noise the gains are judged with, and searches that noise does not mislead."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from optid.armax.model import Armax
from optid.pid.controller import Gains
from optid.pid.pid_step import KD, KI, KP
from optid.tuning import bench_search
from optid.tuning.evolution_strategy import evolution_strategy
from optid.tuning.plant import plant_of
from optid.tuning.search import Evolved, box
from optid.tuning.ultimate import Ultimate


def test_what_disturbs_the_plant_is_no_noise_of_its_sensor():
    """White noise r of a sensor behind (1 - a/z)^-1 driven by noise q is one innovation model, lambda and c."""
    r, q, a = 9e-10, 2e-10, 0.95
    total, product = r * (1.0 + a * a) + q, r * a
    root = math.sqrt(total**2 - 4.0 * product**2)
    c, variance = (total - root) / (2.0 * product), (total + root) / 2.0
    model = Armax(a=(1.0, -a), b=((0.1,),), c=(1.0, -c), nk=(1,), sample_time=1e-3, noise_variance=variance)
    assert variance > 1.4 * r
    assert plant_of(model).noise == pytest.approx(math.sqrt(r + q / (1.0 + a) ** 2), rel=1e-9)
    assert plant_of(model).noise == pytest.approx(math.sqrt(r), rel=0.04)


def test_the_strategy_finds_a_narrow_valley_in_noise():
    """Its lowest point lies on a bound, along a direction of none of the axes."""
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    lowest, scale = np.array([0.0, 0.6, 0.4]), np.diag([1.0, 30.0, 900.0])

    def cost(points, generation):
        off = points - lowest
        exact = 1.0 + np.einsum("ij,jk,ik->i", off, turn @ scale @ turn.T, off)
        return exact * np.exp(0.2 * np.random.default_rng(generation).standard_normal(len(points)))

    ends = [
        evolution_strategy(cost, np.array([0.3, 0.3, 0.3]), 0.1, 60, np.random.default_rng(seed))
        for seed in range(5)
    ]
    off = np.array(ends) - lowest
    assert np.mean(np.einsum("ij,jk,ik->i", off, turn @ scale @ turn.T, off)) < 0.15


def test_the_strategy_ends_where_time_is_up():
    start = np.array([0.3, 0.3])
    late = evolution_strategy(lambda p, g: np.full(len(p), np.inf), start, 0.1, 9, np.random.default_rng(0))
    np.testing.assert_array_equal(late, start)


def test_what_a_search_tried_is_counted(monkeypatch):
    asked = []

    def judged(task, within, points, runs, effort):
        asked.append(len(points))
        return points.sum(axis=1)

    monkeypatch.setattr(bench_search, "_judged", judged)
    monkeypatch.setattr(bench_search, "_episodes", lambda task: [])
    monkeypatch.setattr(bench_search, "_spread_out", lambda task, within, count, rng: rng.random((count, 2)))
    monkeypatch.setattr(bench_search, "_least_feedback", lambda task, within, best, runs: best)
    task = SimpleNamespace(fitness=lambda points: points.sum(axis=1), bench=None)
    within = SimpleNamespace(gains=lambda points: points)
    start = np.full((1, 2), 0.5)
    ends = bench_search.search_on_bench(task, within, start, np.random.default_rng(0), bench_search.Effort())
    assert sum(end.evaluations for end in ends) == sum(asked)
    assert ends[0].fitness < 0.1


def test_of_gains_that_the_runs_cannot_tell_apart_those_with_the_least_feedback_are_taken(monkeypatch):
    runs, within = (1, 2, 3, 4), box(("kp", "ki", "kd"), Gains(kp=1.0), Ultimate(10.0, 0.1))
    worth = 0.0  # of integral action

    def cost(gains, chosen):
        L = np.log(10.0 / gains[:, KP])
        return sum(1.0 + 0.05 * L**2 + 0.1 * (k - 2.5) + worth * (gains[:, KI] == 0.0) for k in chosen) / 4.0

    monkeypatch.setattr(
        bench_search, "_task_of_runs", lambda task, chosen: SimpleNamespace(fitness=lambda g: cost(g, chosen))
    )
    task = SimpleNamespace(fitness=lambda gains: cost(gains, runs))
    start = Evolved(within.points(Gains(kp=10.0, ki=1.0, kd=0.2).vector)[0], 1.0, 0)
    found = within.gains(bench_search._least_feedback(task, within, start, runs).point)[0]
    # The standard error over the runs is 0.1 sqrt(5/4) / sqrt(4), the most that 0.05 ln^2 may be: ln up to 1.057.
    assert found[KP] == pytest.approx(10.0 * 0.84**6, rel=1e-6)
    assert found[KD] / found[KP] == pytest.approx(0.02, rel=1e-6)
    assert found[KI] == 0.0  # it gains nothing
    worth = 0.05
    found = within.gains(bench_search._least_feedback(task, within, start, runs).point)[0]
    assert found[KI] / found[KP] == pytest.approx(0.1, rel=1e-6)
    # Far above the best, the lowest cost counts, not that of the start.
    start = Evolved(within.points(Gains(kp=20.0, ki=2.0, kd=0.4).vector)[0], 2.0, 0)
    found = within.gains(bench_search._least_feedback(task, within, start, runs).point)[0]
    assert found[KP] == pytest.approx(20.0 * 0.84**10, rel=1e-6)
