"""The compiled filter: on a linear plant it is Kalman's, to rounding; steered runs follow its gains."""

import casadi as ca
import numpy as np
from scipy.linalg import expm

from optid.core.parameter import Parameter
from optid.core.recording import Channel, Recording
from optid.core.sheet import build
from optid.estimation import likelihood
from optid.estimation.likelihood import (
    BESIDE,
    WHOLE,
    deviance,
    run_filter,
    run_fixed_gain_filter,
    run_windows,
)
from optid.estimation.problem import TOLERANCE, build_problem

STIFFNESS = Parameter("stiffness", "N/m", 40.0, "spring", "test", 40.0, (0.0, 1e4))
DAMPING = Parameter("damping", "N s/m", 1.5, "damper", "test", 1.5, (0.0, 1e3))


def spring(s):
    """A unit mass on a spring, pushed by the command; two outputs, one of them the sum of both states."""
    x, v = s.state("x", "m", 0.1, spread=0.2), s.state("v", "m/s", 1.0, spread=0.5)
    u = s.input("command", "1")
    s.rate(x, v)
    s.rate(v, 20 * u - s.param(STIFFNESS) * x - s.param(DAMPING) * v)
    s.output("position", "m", x)
    s.output("mixture", "m", x + 0.1 * v)


def recording(n=400, dt=0.01, seed=1):
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1, 1, n // 20), 20)
    A, B = discrete(dt)
    x, y = np.zeros(2), []
    for k in range(n):
        y.append([x[0], x[0] + 0.1 * x[1]] + 0.02 * rng.normal(size=2))
        x = A @ x + B * u[k] + 0.01 * rng.normal(size=2)
    y = np.array(y)
    y[50:60, 0] = np.nan
    time = dt * np.arange(n)
    channels = {
        role: Channel(role, role, unit, values)
        for role, unit, values in (("command", "1", u), ("position", "m", y[:, 0]), ("mixture", "m", y[:, 1]))
    }
    return Recording("spring", time, channels)


def discrete(dt, k=40.0, d=1.5):
    block = np.zeros((3, 3))
    block[:2, :2], block[1, 2] = [[0, 1], [-k, -d]], 20.0
    whole = expm(block * dt)
    return whole[:2, :2], whole[:2, 2]


def kalman(y, u, dt, Q, R):
    """Innovations, variances, states and their covariances, outputs one at a time, written from the textbook."""
    A, B = discrete(dt)
    H = np.array([[1, 0], [1, 0.1]])
    m, C = np.zeros(2), np.diag([0.2**2, 0.5**2])
    E, V, X, S = np.full(y.shape, np.nan), np.full(y.shape, np.nan), [], []
    for n in range(len(y)):
        X.append(m)
        S.append(C)
        for o in range(2):
            if np.isfinite(y[n, o]):
                E[n, o] = y[n, o] - H[o] @ m
                V[n, o] = H[o] @ C @ H[o] + R[o]
                gain = C @ H[o] / V[n, o]
                m, C = m + gain * E[n, o], C - np.outer(gain, gain) * V[n, o]
        m, C = A @ m + B * u[n], A @ C @ A.T + np.diag(Q) * dt
    return E, V, np.array(X), np.array(S)


def test_a_linear_plant_is_filtered_as_by_kalman():
    model, data = build(spring), recording()
    problem = build_problem(model, [data], WHOLE)
    Q, R = np.array([1e-4, 1e-2]), np.array([4e-4, 4e-4])  # Q in squared scales a second
    f = run_filter(model, problem, model.vector({})[None], Q[None], R[None], keep=True, covariances=True)
    E, V, X, S = kalman(problem.measured, problem.inputs[:, 0], 0.01, Q * model.scales**2, R)
    known = np.isfinite(E)
    assert np.array_equal(known, np.isfinite(f.innovations[0]))
    assert np.abs(f.innovations[0] - E)[known].max() < 2e-5
    assert np.abs(f.variances[0] / V - 1)[known].max() < 1e-4
    assert np.abs(f.states[0] - X).max() < 2e-4
    assert np.allclose(f.covariances[0], S, rtol=1e-3, atol=1e-9)


def test_steered_with_its_own_gains_a_linear_model_repeats_the_filter():
    model, data = build(spring), recording()
    problem = build_problem(model, [data], WHOLE)
    p = model.vector({})[None]
    f = run_filter(model, problem, p, np.array([[1e-4, 1e-2]]), np.array([[4e-4, 4e-4]]), keep=True)
    E = run_fixed_gain_filter(model, problem, p, f, range(2))
    known = np.isfinite(f.innovations)
    assert np.abs(E - f.innovations)[known].max() < 2e-5


def test_windows_run_freely_from_the_starts_they_are_given():
    model, data = build(spring), recording()
    problem = build_problem(model, [data], 1.0)
    starts = np.random.default_rng(3).normal(0, [0.1, 1.0], (3, len(problem.begins), 2))
    starts[2, 3] = np.nan
    Y = run_windows(model, problem, model.vector({}), starts, [0, 2, 3])
    assert np.isnan(Y[2, problem.begins[3] :]).all()  # of a start that is not known; the others run on
    A, B = discrete(0.01)
    for s, w in ((0, 0), (2, 2), (1, 3)):
        x, first = starts[s, w], problem.begins[w]
        for n in range(first, first + problem.counts[w] + problem.closed[w]):
            assert np.abs(Y[s, n] - [x[0], x[0] + 0.1 * x[1]]).max() < 2e-5
            x = A @ x + B * problem.inputs[n, 0]
    assert problem.closed.tolist() == [False, False, False, True]
    assert np.isnan(Y[:, problem.begins[1] : problem.begins[2]]).all()


def test_points_see_in_a_linear_output_what_its_slopes_say(monkeypatch):
    model, data = build(spring), recording()
    problem = build_problem(model, [data], WHOLE)
    p, Q, R = model.vector({})[None], np.array([[1e-4, 1e-2]]), np.array([[4e-4, 4e-4]])
    slopes = run_filter(model, problem, p, Q, R, keep=True)
    monkeypatch.setattr(likelihood, "linear_outputs", lambda model: np.zeros(2, dtype=bool))
    points = run_filter(model, problem, p, Q, R, keep=True)
    assert np.nanmax(np.abs(slopes.innovations - points.innovations)) < 1e-10
    assert np.nanmax(np.abs(slopes.variances / points.variances - 1)) < 1e-9
    assert np.abs(slopes.gains - points.gains).max() < 1e-9


def test_an_output_is_linear_where_its_slopes_know_parameters_alone():
    def sensors(s):
        x, v = s.state("x", "m", 1.0), s.state("v", "m/s", 1.0)
        u = s.input("command", "1")
        s.rate(x, v)
        s.rate(v, -x)
        for name, y in (
            ("scaled", s.param(STIFFNESS) * x - v + u**2),
            ("bent", x + x**2),
            ("switched", u * v),
        ):
            s.output(name, "m", y)

    assert likelihood.linear_outputs(build(sensors)).tolist() == [True, False, False]


def test_many_sets_and_segments_equal_single_ones():
    model = build(spring)
    problem = build_problem(model, [recording(seed=1), recording(seed=2)], WHOLE)
    P = np.tile(model.vector({}), (3, 1))
    P[:, 0] *= [0.8, 1.0, 1.3]
    Q, R = np.tile([[1e-4, 1e-2]], (3, 1)), np.tile([[4e-4, 4e-4]], (3, 1))
    together = run_filter(model, problem, P, Q, R).innovations
    for k in range(3):
        alone = run_filter(model, problem, P[k : k + 1], Q[k : k + 1], R[k : k + 1]).innovations[0]
        assert np.array_equal(alone, together[k], equal_nan=True)
    assert np.nanmax(np.abs(together[0] - together[2])) > 1e-3


def test_segments_left_out_stay_empty():
    model = build(spring)
    problem = build_problem(model, [recording(), recording(seed=3)], WHOLE)
    p, Q, R = model.vector({})[None], np.array([[1e-4, 1e-2]]), np.array([[4e-4, 4e-4]])
    both = run_filter(model, problem, p, Q, R).innovations[0]
    second = run_filter(model, problem, p, Q, R, only=[1]).innovations[0]
    start = problem.begins[1]
    assert np.isnan(second[:start]).all()
    assert np.array_equal(second[start:], both[start:], equal_nan=True)


def test_the_integration_is_as_fine_as_process_noise_asks():
    model, data = build(spring), recording()
    problem = build_problem(model, [data], WHOLE)
    p, R = np.tile(model.vector({}), (2, 1)), np.full((2, 2), 4e-4)
    f = run_filter(model, problem, p, np.array([[1e-10, 1e-10], [1e-10, 1.0]]), R)
    assert np.allclose(f.tolerance[0], TOLERANCE * model.scales)
    assert f.tolerance[1, 0] == f.tolerance[0, 0]
    assert np.isclose(
        f.tolerance[1, 1], BESIDE * 0.1 * model.scales[1]
    )  # sqrt(1/s x 10 ms) of its usual size


def test_a_run_that_leaves_the_numbers_has_no_likelihood():
    def bomb(s):
        x = s.state("x", "m", 1.0, start=1.0, spread=0.1)
        s.rate(x, ca.exp(50 * x) + s.input("command", "1"))
        s.output("position", "m", x)
        s.output("mixture", "m", x)

    model = build(bomb)
    problem = build_problem(model, [recording()], WHOLE)
    f = run_filter(model, problem, model.vector({})[None], np.array([[1e-4]]), np.array([[4e-4, 4e-4]]))
    assert not np.isfinite(deviance(f.innovations[0], f.variances[0]).sum())
