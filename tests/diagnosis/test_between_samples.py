"""Inputs that go on between their samples are told from those that are held, by motion in closed form under either."""

import numpy as np
import pytest

from optid.core.recording import Channel, Recording, midpoints
from optid.diagnosis.base_fit import fit_base
from optid.diagnosis.between_samples import inputs_that_go_on, straight_inputs, straightened
from tests.diagnosis.trolley import RATE, SD, TRUTH, problem_of

FINE = 20  # steps of the closed form to a sample


def swept(seed, name, straight, seconds=12.0):
    """A smooth push, read at every sample; it goes on straight in between, or is held."""
    rng, n = np.random.default_rng(seed), round(seconds * RATE)
    t = np.arange(n) / RATE
    u = sum(rng.normal() * np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in (0.4, 1.1, 2.3)) / 2
    between = np.arange(n * FINE) / FINE
    push = TRUTH["gain"] * (np.interp(between, np.arange(n), u) if straight else np.repeat(u, FINE))
    step, x, v, out = 1 / RATE / FINE, 0.0, 0.0, []
    decay = np.exp(-TRUTH["drag"] * step)
    for k, one in enumerate(push):
        if k % FINE == 0:
            out.append(x)
        final = one / TRUTH["drag"]
        x, v = x + final * step + (v - final) * (1 - decay) / TRUTH["drag"], final + (v - final) * decay
    measured = np.array(out) + SD * rng.standard_normal(n)
    channels = {
        "command": Channel("command", "u", "1", u),
        "position": Channel("position", "x", "m", measured, sd=SD),
    }
    return Recording(name, t, channels)


@pytest.mark.parametrize("straight", [False, True])
def test_windows_say_whether_an_input_is_held_or_goes_on(tmp_path, straight):
    problem = problem_of(tmp_path, [swept(seed, f"{seed}.csv", straight) for seed in (1, 2)])
    base, search = fit_base(problem.at_search_accuracy())
    roles = inputs_that_go_on(base, search)
    assert roles == (("command",) if straight else ())
    if straight:  # and the parameters are then right, which they are not if it is held
        again, _ = fit_base(straightened(problem, roles))
        assert again.values["drag"] == pytest.approx(TRUTH["drag"], rel=0.01)
        assert again.fit.loss < 0.5 * base.fit.loss


def test_an_input_that_rests_between_jumps_is_held(tmp_path):
    smooth = swept(1, "1.csv", True)
    jumps = np.repeat(smooth["command"].values[::30], 30)[: len(smooth)]
    channels = {**smooth.channels, "command": Channel("command", "u", "1", jumps)}
    problem = problem_of(tmp_path, [Recording("1.csv", smooth.time, channels)])
    base, search = fit_base(problem.at_search_accuracy())
    assert inputs_that_go_on(base, search) == ()


def test_straight_lines_change_inputs_only_and_keep_what_is_missing():
    one = swept(1, "1.csv", True)
    (other,) = straight_inputs([one], ("command",))
    assert other["position"].values is one["position"].values
    assert np.array_equal(other["command"].values, midpoints(one["command"].values))
    values = np.array([0.0, 2.0, np.nan, 4.0, 6.0])
    assert np.array_equal(midpoints(values), [1.0, 2.0, np.nan, 5.0, 6.0], equal_nan=True)
