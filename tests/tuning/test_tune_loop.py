"""The compiled loop, its costs, its gradient and its margins, against plain Python, CasADi and python-control."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from optid.core.llvm_simd import LANES
from optid.errors import InputError
from optid.pid.controller import AntiWindup, Controller, Gains, Notch, Settings
from optid.pid.pid_step import GAINS, MEMORY
from optid.tuning.criterion import Criterion
from optid.tuning.gradient import Gradient, forward_sensitivities
from optid.tuning.integral_criteria import Measure
from optid.tuning.loop import HUNTING
from optid.tuning.loop_code import initial_state
from optid.tuning.margins import Frequencies, Required, excess, margins
from optid.tuning.plant import plant_of
from optid.tuning.response_metrics import response
from optid.tuning.scenarios import load, moves, profile, step
from optid.tuning.search import PLACES
from optid.tuning.task import Aggregation, Task
from tests.tuning.small_axis import T, axis, python_control

FAST = Gains(40.0, 60.0, 0.6, 4e-3, 0.9)
LIMITED = Settings(T, -5, 5, rate=800.0, resolution=0.01)
WHOLE = Settings(
    T,
    -5,
    4,
    deadband_low=-0.2,
    deadband_high=0.3,
    deadband_onset=0.1,
    anti_windup=AntiWindup.BACK_CALCULATION,
    tracking_time=0.05,
    acceleration=0.02,
    friction=0.1,
    friction_speed=0.05,
    notch=Notch(30.0, 10.0, 0.5),
)


def plainly(model, gains, settings, episode):
    """The loop in plain Python: the difference equation and the controller's own object."""
    controller = Controller(gains, settings)
    controller.reset(0.0, 0.0)
    y, u = [], []
    for n in range(episode.reference.size):
        past_y = [y[n - i] if n >= i else 0.0 for i in range(1, len(model.a))]
        driven = [
            u[n - k] + episode.load[n - k] if n >= k else 0.0
            for k in range(model.nk[0], model.nk[0] + len(model.b[0]))
        ]
        y.append(-np.dot(model.a[1:], past_y) + np.dot(model.b[0], driven))
        u.append(controller.step(float(episode.reference[n]), y[n]))
    return np.array(y), np.array(u)


EPISODES = {
    "step": replace(step(0.06, 300, T), rest=200),
    "moves": moves([(0.0, 0.03), (0.2, -0.02), (0.4, 0.01)], 300, T),
    "load": load(0.5, 300, T),
    "profile": profile(0.05 * np.sin(np.arange(300) / 30), T),
}


@pytest.mark.parametrize("settings", [Settings(T), LIMITED, WHOLE], ids=["free", "limited", "whole"])
@pytest.mark.parametrize("name", EPISODES)
@pytest.mark.parametrize("delay", [1, 4])
def test_compiled_loop_is_the_plain_one(name, settings, delay):
    model, episode = axis(delay=delay), EPISODES[name]
    task = Task((plant_of(model),), (episode,), settings)
    y, u = task.closed_loop.trace(FAST.vector)
    expected_y, expected_u = plainly(model, FAST, settings, episode)
    np.testing.assert_allclose(y, expected_y, atol=1e-11)
    np.testing.assert_allclose(u, expected_u, atol=0.0101 if settings.resolution else 1e-8)
    run = response(episode, y, u, T)
    # More than one group of lanes, the last one not full.
    parts = task.closed_loop.parts(np.tile(FAST.vector, (LANES + 3, 1)))
    assert np.all(parts == parts[0])
    assert parts[0, 0, 0, 0] == pytest.approx(run.measures["itae"], rel=1e-9)
    assert parts[0, 0, 0, 1] * task.command_size == pytest.approx(run.travel, rel=1e-9)
    assert parts[0, 0, 0, 2] == pytest.approx(run.overshoot, abs=1e-12)
    assert parts[0, 0, 0, HUNTING] == pytest.approx(run.hunting, abs=1e-12)


def test_itae_of_a_known_response():
    """y = r (1 - exp(-t / tau)): ITAE is r tau^2 in continuous time."""
    tau, n = 0.1, 4000
    time = 5e-4 * np.arange(n)
    run = response(step(0.06, n, 5e-4), 0.06 * (1 - np.exp(-time / tau)), np.zeros(n), 5e-4)
    assert run.measures["itae"] == pytest.approx(0.06 * tau**2, rel=1e-3)
    assert run.measures["iae"] == pytest.approx(0.06 * tau, rel=5e-3)
    assert run.measures["ise"] == pytest.approx(0.06**2 * tau / 2, rel=1e-2)
    assert run.measures["itse"] == pytest.approx(0.06**2 * tau**2 / 4, rel=1e-3)
    assert run.settled == pytest.approx(tau * np.log(50), abs=1e-3)


def test_command_keeps_its_limits(task):
    rng = np.random.default_rng(0)
    limited = replace(task, settings=LIMITED)
    for gains in rng.uniform(0, 1, (30, GAINS)) * [500, 5000, 10, 0.01, 1.5, 1]:
        _, u = limited.closed_loop.trace(gains)
        u = u[np.isfinite(u)]
        assert u.min() >= -5 and u.max() <= 5
        assert np.abs(np.diff(u, prepend=0.0)).max() <= 800.0 * T + 1e-9


@pytest.mark.parametrize("measure", Measure)
@pytest.mark.parametrize(
    "settings", [Settings(T, -5, 5), Settings(T, -5, 5, rate=900.0)], ids=["limits", "rate"]
)
def test_gradient_is_exact(model, measure, settings):
    free = ("kp", "ki", "kd", "setpoint_weight", "derivative_filter")
    episodes = (step(0.06, 300, T), load(0.5, 300, T))
    task = Task((plant_of(model),), episodes, settings, Criterion(measure, effort=0.3, overshoot=2.0))
    vector = FAST.vector
    value, slope = Gradient(task, free)(vector)
    assert value == pytest.approx(task.closed_loop.costs(vector)[0, 0], rel=1e-9)
    for j, name in enumerate(free):
        h = 1e-5 * max(abs(vector[PLACES[name]]), 1e-3)
        sides = np.tile(vector, (2, 1))
        sides[0, PLACES[name]] += h
        sides[1, PLACES[name]] -= h
        up, down = task.closed_loop.costs(sides)[:, 0]
        assert slope[j] == pytest.approx((up - down) / (2 * h), rel=2e-3, abs=1e-6 * value)


def test_gradient_is_that_of_casadi(task):
    """Machine code and CasADi's own virtual machine agree on state and derivatives after every sample."""
    free, loop = ("kp", "kd"), task.closed_loop
    function = forward_sensitivities(loop.order, loop.squared_error, loop.settings, free)
    start = initial_state(loop.order, 0.0, 1).ravel()
    w, plant = np.concatenate([start, np.zeros(2 * start.size)]), loop.plant_rows[0]
    for column in loop.episode_rows[0].T:
        w = function(w, FAST.vector, plant, loop.settings, column)
    order = loop.order
    rows = np.array(w).reshape(3, -1)[:, order + MEMORY]
    value, slope = Gradient(task, free)(FAST.vector)
    np.testing.assert_allclose([value, *slope], rows, rtol=1e-9)
    assert isinstance(w, ca.DM)


def test_gradient_sees_through_the_resolution(model):
    """The steps of the command have no slope of their own: the gradient is that of the loop without them."""
    fine, stepped = (
        Task((plant_of(model),), (step(0.06, 300, T),), Settings(T, -5, 5, resolution=resolution))
        for resolution in (0.0, 0.01)
    )
    one, two = (Gradient(task, ("kp", "kd"))(FAST.vector) for task in (fine, stepped))
    np.testing.assert_allclose(one[1], two[1], rtol=1e-12)
    assert one[0] == pytest.approx(stepped.closed_loop.costs(FAST.vector)[0, 0], rel=0.05)


def test_gradient_over_scenarios(model):
    from optid.tuning.plant import scenarios

    plants = scenarios(axis(spread=0.05), 4, np.random.default_rng(1))
    for over in Aggregation:
        smooth = Criterion(Measure.ISE)
        task = Task(plants, (step(0.06, 300, T),), Settings(T, -5, 5), smooth, over=over)
        value, slope = Gradient(task, ("kp",))(FAST.vector)
        h = 1e-4
        sides = np.tile(FAST.vector, (2, 1)) + np.outer([h, -h], np.eye(GAINS)[0])
        up, down = task.together(task.closed_loop.costs(sides))
        assert value == pytest.approx(task.together(task.closed_loop.costs(FAST.vector))[0], rel=1e-9)
        assert slope[0] == pytest.approx((up - down) / (2 * h), rel=1e-3)


@pytest.mark.parametrize(
    "gains", [FAST, Gains(10.0), Gains(25.0, 0.0, 0.3, 2e-3), Gains(45.0, 400.0, 1.0, 1e-3)], ids=str
)
def test_margins_are_python_controls(model, gains):
    import control

    L = python_control(model, gains)
    found, grid = margins(plant_of(model), gains.vector), np.geomspace(1e-2, np.pi / T, 200_000)
    gain, phase, *_ = control.stability_margins(L, method="frd", returnall=False)
    response = L(np.exp(1j * grid * T))
    assert found.stable == bool(np.all(np.abs(control.feedback(L, 1).poles()) < 1))
    assert found.stable
    assert found.maximum_sensitivity == pytest.approx(np.max(1 / np.abs(1 + response)), rel=1e-5)
    assert found.gain_margin == pytest.approx(gain, rel=1e-3)
    assert found.phase_margin == pytest.approx(phase, rel=1e-3)
    # The delay margin, by adding delay until the phase margin is gone.
    crossing = np.flatnonzero(np.diff(np.abs(response) > 1))
    left = [np.mod(np.angle(response[i]) + np.pi, 2 * np.pi) / grid[i] for i in crossing]
    assert found.delay_margin == pytest.approx(min(left), rel=1e-3)


def test_unstable_loops_are_seen(model):
    import control

    plant, rng = plant_of(model), np.random.default_rng(3)
    grid = Frequencies.of(plant, 200)
    gains = rng.uniform(0, 1, (200, GAINS)) ** 3 * [800, 20000, 20, 0.01, 1, 1]
    gains[:20, 1] = 0.0
    gains[20:40, 2] = 0.0
    missed = excess(plant, grid, Required().bounds, gains)
    poles = [control.feedback(python_control(model, Gains(*g)), 1).poles() for g in gains]
    stable = np.array([np.all(np.abs(p) < 1.0) for p in poles])
    assert 20 < stable.sum() < 180
    np.testing.assert_array_equal(missed == 0.0, stable)


def test_the_controller_must_run_at_the_models_rate(model):
    with pytest.raises(InputError) as error:
        Task((plant_of(model),), (step(0.06, 300, T),), Settings(1e-3, -5, 5))
    assert error.value.field == "sample_time"


def test_episodes_of_one_length(model):
    with pytest.raises(InputError):
        Task((plant_of(model),), (step(0.06, 300, T), step(0.06, 200, T)), Settings(T, -5, 5))
    with pytest.raises(InputError):
        moves([(0.0, 0.0)], 100, T)
    with pytest.raises(InputError):
        moves([(0.1, 0.01), (0.05, 0.02)], 100, T)
    with pytest.raises(InputError):
        load(0.0, 100, T)
