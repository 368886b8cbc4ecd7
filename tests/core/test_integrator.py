"""The compiled integrator against SciPy's Radau on the same equations, and the slopes against CasADi's."""

from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from numba import njit
from scipy.integrate import solve_ivp

from optid.core.gauss_newton_kernels import normal_equations
from optid.core.jit import compiled, compiled_runs
from optid.core.kernel import at, call
from optid.core.sheet import build
from optid.core.simulation import simulate
from optid.rigs.rigfile import read_rig
from optid.rigs.servo_pneumatic import servo_pneumatic

DATA = Path(__file__).parents[2] / "data"
VALUES = read_rig(DATA / "table1.toml").parameters


def rich(n, rng):
    """A command of steps held for 20 ms on samples of 1 ms, both signs, up to 80 %."""
    return np.repeat(rng.uniform(-0.8, 0.8, n // 20 + 1), 20)[:n, None]


@pytest.mark.parametrize("friction", ["bristle", "smooth"])
def test_position_agrees_with_radau(friction):
    model = build(servo_pneumatic, friction=friction)
    widths = {"friction_width": 1e-2} if friction == "smooth" else {}
    p = model.vector({**VALUES, **widths})
    n, u = 150, rich(150, np.random.default_rng(7))
    x0 = np.array(model.start(p)[0]).ravel()
    run = simulate(model, p, x0, np.full(n, 1e-3), u)
    x, exact = x0, [x0]
    for k in range(n - 1):
        right = solve_ivp(
            lambda _, z, held=u[k]: np.array(model.rates(z, held, p)).ravel(),
            (0, 1e-3),
            x,
            method="Radau",
            rtol=1e-10,
            atol=1e-10 * model.scales,
        )
        x = right.y[:, -1]
        exact.append(x)
    error = np.abs(run.states[0] - exact)
    assert error[:, 0].max() < 1e-8  # 0.01 micrometre
    assert (np.ptp(np.array(exact)[:, 0])) > 1e-3  # it did move


def test_many_runs_at_once_equal_single_ones():
    model = build(servo_pneumatic)
    rng, n = np.random.default_rng(3), 200
    u, dt = rich(n, rng), np.full(n, 1e-3)
    P = np.tile(model.vector(VALUES), (5, 1))
    P[:, model.index("payload_mass")] *= rng.uniform(0.5, 2, 5)
    x0 = np.array(model.start(P[0])[0]).ravel()
    together = simulate(model, P, x0, dt, u).outputs
    for k in range(5):
        assert np.array_equal(simulate(model, P[k], x0, dt, u).outputs[0], together[k])
    assert np.ptp(together[:, -1, 0]) > 0


def test_slopes_of_a_window_are_those_of_its_end():
    model = build(servo_pneumatic)
    free = (model.index("viscous_friction"), model.index("presliding_length"))
    machine, p, n = compiled(model, free), model.vector(VALUES), 60
    u, dt, nx = rich(n, np.random.default_rng(5)), np.full(n, 1e-3), len(model.states)
    start, scales = np.array(model.start(p)[0]).ravel(), model.scales

    def window(x0, q):
        end, slope = np.empty((1, nx)), np.empty((1, nx, machine.width))
        H, g, cost = np.empty((1, nx + 2, machine.width)), np.empty((1, machine.width)), np.empty((1, 2))
        none = np.full((n, len(model.outputs)), np.nan)
        machine.run(
            normal_equations,
            0,
            1,
            np.array([0]),
            np.array([n - 1]),
            np.array([True]),
            x0[None],
            q,
            dt,
            u,
            none,
            np.ones_like(none),
            np.inf,
            1e-9 * scales,
            end,
            slope,
            H,
            g,
            cost,
        )
        return end[0], slope[0]

    _, slope = window(start, p)
    for d in range(nx + 2):
        size = 1e-6 * (scales[d] if d < nx else p[free[d - nx]])
        plus, minus = (window(*_moved(start, p, free, d, s * size))[0] for s in (1, -1))
        numeric = (plus - minus) / (2 * size)
        unit = scales / size * 1e-6
        assert slope[:, d] / unit == pytest.approx(numeric / unit, rel=2e-3, abs=2e-4)


def _moved(x, p, free, d, by):
    x, p = x.copy(), p.copy()
    if d < len(x):
        x[d] += by
    else:
        p[free[d - len(x)]] += by
    return x, p


@njit
def rates(code, x, u, p, c, out):
    call(code.constants, (at(p, 0), at(c, 0)))
    call(code.rates, (at(x, 0), at(x, 0), at(u, 0), at(c, 0), at(out, 0), at(out, 0)))


@pytest.mark.parametrize(
    "options", [{}, {"friction": "smooth"}, {"reversed_flow": False, "rod_force": False}]
)
def test_emitted_equations_are_casadis(options):
    model = build(servo_pneumatic, **options)
    p, rng = model.vector(VALUES), np.random.default_rng(1)
    code = compiled_runs(model).code
    c, out = np.empty(code.hoisted), np.empty(len(model.states) + 1)
    for _ in range(50):
        x = np.array([*rng.normal(0, [0.05, 0.5]), *rng.uniform(0.8e5, 8e5, 2), *rng.uniform(-1, 1, 1)])
        x, u = x[: len(model.states)], rng.uniform(-1, 1, 1)
        rates(code, x, u, p, c, out)
        assert out[:-1] == pytest.approx(np.array(ca.DM(model.rates(x, u, p))).ravel(), rel=1e-9, abs=1e-9)
