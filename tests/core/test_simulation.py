"""Windows carried one after the other, and runs that leave the numbers."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from optid.core.parameter import Parameter
from optid.core.sheet import build
from optid.core.simulation import carry, simulate

RATE = Parameter("rate", "1/s", 3.0, "of the decay", "a test", bounds=(0.0, 100.0))


@dataclass(frozen=True)
class Cut:
    """Windows of some samples, in two segments."""

    dt: np.ndarray
    inputs: np.ndarray
    begins: np.ndarray
    counts: np.ndarray
    closed: np.ndarray


def decay(s):
    """x' = v, v' = u - rate v."""
    x, v = s.state("x", "m", 1.0), s.state("v", "m/s", 1.0)
    s.rate(x, v)
    s.rate(v, s.input("push", "1") - s.param(RATE) * v)
    s.output("position", "m", x)


@pytest.fixture
def cut():
    rng = np.random.default_rng(1)
    begins, counts = np.array([0, 10, 25, 41]), np.array([10, 15, 15, 20])
    closed = np.array([False, False, True, True])
    return Cut(rng.uniform(5e-3, 2e-2, 62), rng.normal(size=(62, 1)), begins, counts, closed)


def test_carried_windows_are_simulated_ones(cut):
    model = build(decay)
    P, start = np.array([[2.0], [5.0]]), np.array([[0.1, 0.2], [0.3, 0.4]])
    known = np.full((4, 2), np.nan)
    known[1, 0], known[3] = 7.0, (8.0, 9.0)
    found = carry(model, P, start, cut, known)
    for r in range(2):
        x = start[r]
        for w, (begin, count) in enumerate(zip(cut.begins, cut.counts, strict=True)):
            x = start[r] if w == 3 else x
            x = np.where(np.isnan(known[w]), x, known[w])
            assert found.nodes[r, w] == pytest.approx(x, rel=1e-12)
            run = simulate(model, P[r], x, cut.dt, cut.inputs, first=np.array([begin]), intervals=int(count))
            own = slice(begin, begin + count + int(cut.closed[w]))
            assert found.outputs[r, own] == pytest.approx(run.outputs[0][: own.stop - own.start], rel=1e-9)
            x = run.states[0, count]
            assert found.ends[r, w] == pytest.approx(x, rel=1e-9)


def test_a_window_that_leaves_the_numbers_ends_there(cut):
    def escape(s):
        x = s.state("x", "m", 1.0)
        s.rate(x, x * x + 0 * s.input("push", "1"))
        s.output("position", "m", x)

    model, known = build(escape), np.full((4, 1), np.nan)
    known[2] = 0.5
    found = carry(model, np.empty((1, 0)), np.array([[20.0]]), cut, known)
    assert np.isnan(found.ends[0, :2]).all()
    assert found.nodes[0, 1] == found.nodes[0, 0] == 20.0  # carried over from the node before
    assert np.isnan(found.outputs[0, 24])
    assert found.ends[0, 2] > 0.5


def test_a_run_that_would_take_hours_leaves_the_numbers():
    """A state that relaxes within nanoseconds, in holds of a millisecond: a million steps each."""

    def stiff(s):
        x = s.state("x", "m", 1.0)
        s.rate(x, s.input("push", "1") - s.param(replace(RATE, bounds=(0.0, 1e12))) * x)
        s.output("position", "m", x)

    model, dt, push = build(stiff), np.full(4, 1e-3), np.ones((4, 1))
    x = simulate(model, np.array([[1e5], [2e9]]), np.array([1.0]), dt, push).states[:, :, 0]
    assert x[0, 1:] == pytest.approx(1e-5, rel=1e-3)
    assert np.isnan(x[1, 1:]).all()
