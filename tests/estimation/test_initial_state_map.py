"""The likeliest start: on a linear plant that of a Kalman filter, and where friction holds no normal distribution."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from optid.core.recording import Channel, Recording
from optid.core.sheet import build
from optid.estimation.initial_state_map import InitialSegment, StatePrior, carried, likely_start, nearest
from optid.estimation.likelihood import WHOLE, Noise, Start, run_filter, start_of
from optid.estimation.problem import build_problem

SD, DT, SPREAD = 1e-4, 1e-3, 1.5
QUIETEST = Noise(np.array([SD**2]), ((1,),), np.log([1e-6]))


def decaying(s):
    """x' = v, v' = load - v, the load decays: linear, with two states that no sensor shows."""
    x, v = s.state("x", "m", 0.01), s.state("v", "m/s", 1.0, spread=SPREAD)
    load = s.state("load", "m/s2", 1.0, spread=SPREAD)
    push = s.input("command", "m/s2")
    s.rate(x, v)
    s.rate(v, load + push - v)
    s.rate(load, -load)
    s.output("position", "m", x)


def held(s):
    """x' = load beyond -1 and 1, nothing in between."""
    x, load = s.state("x", "m", 0.01), s.state("load", "m/s", 1.0, spread=SPREAD)
    force = load + s.input("command", "m/s")
    s.rate(x, force - ca.fmin(ca.fmax(force, -1), 1))
    s.rate(load, -2 * load)
    s.output("position", "m", x)


def opening(plant, x, noise, moved, push=0.0):
    """Of a record of x, up to but without its last sample."""
    model = build(plant)
    channels = {
        "command": Channel("command", "u", "1", np.full(len(x), push)),
        "position": Channel("position", "x", "m", x, sd=SD),
    }
    problem = build_problem(model, [Recording("a", DT * np.arange(len(x)), channels)], WHOLE)
    problem.measured[-1] = np.nan
    p = model.vector({})
    start = start_of(model, p[None], 1)
    sd = np.sqrt(np.diagonal(start.covariance[0, 0]))
    return InitialSegment(model, p, noise, problem, StatePrior(start.mean[0, 0], sd, np.array(moved)))


def decayed(samples, process_noise):
    """Of so many samples of the linear plant."""
    rng, v, load, x = np.random.default_rng(3), 0.7, -1.2, np.zeros(samples)
    for k in range(1, samples):
        x[k] = x[k - 1] + DT * v
        v, load = v + DT * (load + 0.5 - v), load - DT * load
    noise = Noise(np.array([SD**2]), ((1, 2),), np.log([process_noise]))
    return opening(decaying, x + SD * rng.standard_normal(samples), noise, [1, 2], push=0.5)


@pytest.fixture(params=[1e-6, 1e-3], ids=["no process noise", "process noise"])
def linear(request):
    return decayed(300, request.param)


@pytest.mark.parametrize("samples", [300, 12], ids=["long", "so short that what was known before counts"])
@pytest.mark.parametrize("process_noise", [1e-6, 1e-3])
def test_on_a_linear_plant_a_look_ends_where_a_kalman_filter_does(samples, process_noise):
    o = decayed(samples, process_noise)
    likely = likely_start(o, np.array([0.0, 3.0]))
    mean, covariance, normal = carried(o, [likely])
    Q, R = o.noise.spectrum(3)[None], o.noise.measurement[None]
    exact = run_filter(
        o.model,
        o.problem,
        o.p[None],
        Q,
        R,
        keep=True,
        covariances=True,
        start=Start.apart(o.known.mean[None, None], o.known.sd[None, None]),
    )
    sd = np.sqrt(np.diagonal(exact.covariances[0, -1]))
    assert normal
    assert (np.abs(mean - exact.states[0, -1]) < 0.1 * sd).all()
    apart = np.linalg.solve(exact.covariances[0, -1], covariance)
    assert np.linalg.eigvals(apart).real == pytest.approx(1.0, abs=0.1)


def test_it_is_found_from_both_sides(linear):
    ends = [likely_start(linear, np.array(z)) for z in ([2.0, -1.5], [-2.0, 1.5])]
    assert ends[0].z == pytest.approx(ends[1].z, abs=0.01)
    assert ends[0].cost == pytest.approx(ends[1].cost, abs=0.2)


def test_what_does_not_move_is_left_to_the_filter(linear):
    """Which knows as little of the speed, and so says the same of the load."""
    load = replace(linear, known=replace(linear.known, moved=np.array([2])))
    likely, both = likely_start(load, np.zeros(1)), likely_start(linear, np.zeros(2))
    assert likely.z == pytest.approx(both.z[1:], abs=1e-3)
    assert likely.root @ likely.root.T == pytest.approx((both.root @ both.root.T)[1:, 1:], rel=0.05)


def test_what_is_known_to_rest_begins_at_rest(linear):
    """A speed that is known leaves the load to explain the path."""
    sd = np.array([linear.known.sd[0], 1e-6, SPREAD])
    rests = replace(linear, known=StatePrior(np.zeros(3), sd, np.array([2])))
    moving, still = likely_start(linear, np.zeros(2)), likely_start(rests, np.zeros(1))
    assert still.cost > moving.cost + 100.0
    assert np.abs(still.z - moving.z[1:]) > 10.0 * np.linalg.norm(moving.root[1])


def test_the_nearest_starts_come_first(linear):
    best = likely_start(linear, np.zeros(2)).z
    Z = best + np.array([[0.0, 0.0], [0.05, 0.0], [-0.3, 0.0], [1.5, 0.0]])
    assert np.array_equal(nearest(linear, Z[[0, 3, 1, 2]], 3), Z[:3])


def test_loads_that_friction_holds_are_no_normal_distribution():
    still = opening(held, SD * np.random.default_rng(4).standard_normal(200), QUIETEST, [1])
    likely = likely_start(still, np.array([0.3]))
    _, _, normal = carried(still, [likely])
    assert not normal
    assert abs(still.known.mean[1] + likely.z[0] * SPREAD) < 1.0


def test_a_start_at_which_the_model_leaves_the_numbers_speaks_against_itself():
    def runaway(s):
        x, load = s.state("x", "m", 0.01), s.state("load", "m/s", 1.0, spread=SPREAD)
        s.input("command", "m/s")
        s.rate(x, load)
        s.rate(load, ca.exp(1e3 * load))
        s.output("position", "m", x)

    lost = opening(runaway, np.zeros(100), QUIETEST, [1])
    likely = likely_start(lost, np.array([2.0]))
    assert likely.cost == np.inf
    assert not carried(lost, [likely])[2]


def test_starts_about_as_likely_widen_what_is_known_and_unlikely_ones_do_not(linear):
    best = likely_start(linear, np.zeros(2))
    alone, covariance, _ = carried(linear, [best])
    for behind, weight in ((0.0, 0.5), (4.0, 1 / (1 + np.exp(2.0))), (1e4, 0.0)):
        other = replace(best, cost=best.cost + behind, end=best.end + np.array([0.0, 0.3, -0.2]))
        mean, wider, _ = carried(linear, [best, other])
        off = other.end - best.end
        assert mean == pytest.approx(alone + weight * off, abs=1e-9)
        assert wider - covariance == pytest.approx(weight * (1 - weight) * np.outer(off, off), abs=1e-9)


def test_a_filter_begun_anew_with_what_it_knew_goes_on_as_if_it_had_not(linear):
    o, row = linear, 120
    given = (o.p[None], o.noise.spectrum(3)[None], o.noise.measurement[None])
    start = Start.apart(o.known.mean[None, None], o.known.sd[None, None])
    whole = run_filter(o.model, o.problem, *given, keep=True, covariances=True, start=start)
    rest = replace(o.problem, begins=np.array([row]), counts=o.problem.counts - row)
    anew = Start(whole.states[:, row][None], whole.covariances[:, row][None])
    again = run_filter(o.model, rest, *given, keep=True, start=anew)
    assert again.innovations[0, row:-1] == pytest.approx(whole.innovations[0, row:-1], abs=1e-9)
    assert again.variances[0, row:-1] == pytest.approx(whole.variances[0, row:-1], rel=1e-6)
