"""The linearly implicit step: its order, its stability, and an elimination that any pattern of zeros survives."""

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from optid.core.rosenbrock import _factorised, rosenbrock
from optid.core.sheet import build
from optid.rigs.rigfile import read_rig
from optid.rigs.servo_pneumatic import servo_pneumatic
from tests.core.test_integrator import DATA


@pytest.fixture(scope="module")
def axis():
    """The paper's axis with seals that slide after 0.2 mm, its parameters, and a moving state with a moving command."""
    model = build(servo_pneumatic)
    p = model.vector(read_rig(DATA / "table1.toml").parameters | {"presliding_length": 2e-4})
    x = np.array(model.start(p)[0]).ravel()
    x[[state.name for state in model.states].index("velocity")] = 0.3
    return model, p, x


def exact(model, p, x, u, h):
    rates = model.rates
    found = solve_ivp(
        lambda _, y: np.array(rates(y, u, p)).ravel(),
        (0.0, h),
        x,
        method="Radau",
        rtol=1e-11,
        atol=1e-13 * model.scales,
    )
    return found.y[:, -1]


def test_a_step_is_of_order_three_and_its_error_estimate_of_order_two(axis):
    model, p, x = axis
    step, lengths = rosenbrock(model), np.array([2e-4, 1e-4, 5e-5, 2.5e-5])
    missed, said = [], []
    for h in lengths:
        end, left_out = np.split(np.array(step(x, 0.5, p, h, 0)).ravel(), 2)
        missed.append(np.abs((end - exact(model, p, x, 0.5, h)) / model.scales).max())
        said.append(np.abs(left_out / model.scales).max())
    order, order_said = (np.polyfit(np.log(lengths), np.log(e), 1)[0] for e in (missed, said))
    assert order == pytest.approx(4.0, abs=0.3)  # of one step
    assert order_said == pytest.approx(3.0, abs=0.3)
    assert np.all(np.array(said) > missed)


def test_a_long_step_at_rest_stays_at_rest(axis):
    model, p, _ = axis
    stiff = p.copy()
    stiff[model.index("presliding_length")] = 3e-7  # bristles swing within 0.1 ms
    x = np.array(model.start(stiff)[0]).ravel()
    v = [state.name for state in model.states].index("velocity")
    x[v] = 1e-4
    step = rosenbrock(model)
    for _ in range(20):
        x = np.array(step(x, 0.0, stiff, 5e-3, 0)).ravel()[: len(x)]
    assert abs(x[v]) < 1e-6


def test_elimination_solves_with_any_pattern_of_zeros():
    rng = np.random.default_rng(4)
    for n in (1, 3, 6):
        for _ in range(10):
            W = np.where(rng.random((n, n)) < 0.4, rng.normal(size=(n, n)), 0.0) + n * np.eye(n)
            b = rng.normal(size=n)
            symbol = ca.SX.sym("W", ca.sparsify(ca.DM(W)).sparsity())
            right = ca.SX.sym("b", n)
            solve = ca.Function("solve", [symbol, right], [_factorised(symbol)(right)])
            assert np.array(solve(ca.sparsify(ca.DM(W)), b)).ravel() == pytest.approx(np.linalg.solve(W, b))
