"""Several numbers at once: every instruction lane by lane as for one number, and the functions that are optid's own."""

import casadi as ca
import numpy as np
import pytest
from llvmlite import ir
from numba import njit

from optid.core.instructions import FORMS, REAL
from optid.core.jit import compiled_lanes, machine_code
from optid.core.kernel import at, call
from optid.core.llvm_simd import LANES
from optid.core.recording import Channel, Recording
from optid.core.rosenbrock import rosenbrock
from optid.core.sheet import build
from optid.estimation.likelihood import WHOLE, run_filter
from optid.estimation.problem import build_problem
from optid.rigs.rigfile import read_rig
from optid.rigs.servo_pneumatic import servo_pneumatic
from tests.core.test_integrator import DATA

SEVERAL = ir.VectorType(REAL, LANES)


@njit
def applied(one, x, y, out):
    for i in range(0, x.size, out.shape[1]):
        call(one, (at(x, i), at(y, i), at(out, i)))


def function(module, name, kind, form, count):
    """name(x, y, out): out = form(x, y) of numbers of a kind."""
    place = REAL.as_pointer()
    code = ir.Function(module, ir.FunctionType(REAL, [place] * 3), name)
    b = ir.IRBuilder(code.append_basic_block())
    x, y, out = (b.bitcast(argument, kind.as_pointer()) for argument in code.args)
    b.store(form(b, *[b.load(p, align=8) for p in (x, y)][:count]), out, align=8)
    b.ret(ir.Constant(REAL, 0.0))


@pytest.fixture(scope="module")
def machine():
    module = ir.Module("forms")
    for code, (count, form) in FORMS.items():
        function(module, f"one_{code}", REAL, form, count)
        function(module, f"many_{code}", SEVERAL, form, count)
    return machine_code(str(module), lambda: str(module))


def run(machine, kind, code, x, y):
    out = np.empty((len(x), 1) if kind == "one" else (len(x) // LANES, LANES))
    applied(machine.get_function_address(f"{kind}_{code}"), x, y, out)
    return out.ravel()


def test_every_instruction_does_in_lanes_what_it_does_alone(machine):
    rng = np.random.default_rng(1)
    x = np.r_[rng.normal(0, 2, 400), rng.uniform(-1, 1, 396), 0.0, 1.0, -1.0, 3.0]
    y = np.r_[rng.normal(0, 2, 400), x[400:796], 0.0, 1.0, 2.0, -2.0]
    for code in FORMS:
        one, many = (run(machine, kind, code, x, y) for kind in ("one", "many"))
        off = 1e-14 if code in (ca.OP_POW, ca.OP_CONSTPOW) else 1e-15  # the error of y log x shows in x^y
        assert many == pytest.approx(one, rel=off, abs=1e-300, nan_ok=True), code


@pytest.mark.parametrize(
    ("code", "exact", "values"),
    [
        (ca.OP_EXP, np.exp, np.r_[np.linspace(-700, 700, 4001), np.linspace(-1, 1, 3999)]),
        (ca.OP_LOG, np.log, np.r_[np.logspace(-300, 300, 4000), np.linspace(0.5, 2, 4000)]),
        (ca.OP_LOG1P, np.log1p, np.r_[np.logspace(-300, 300, 4000), np.linspace(-0.999, 2, 4000)]),
        (ca.OP_SIN, np.sin, np.linspace(-3, 3, 8000)),
        (ca.OP_COS, np.cos, np.linspace(-1.5, 1.5, 8000)),
        (ca.OP_TANH, np.tanh, np.r_[np.linspace(-25, 25, 4000), np.logspace(-12, 0, 4000)]),
    ],
)
def test_own_functions_are_good_to_the_last_digits(machine, code, exact, values):
    found = run(machine, "many", code, values, values)
    assert (np.abs(found - exact(values)) <= 5e-16 * np.abs(exact(values))).all()


def test_own_functions_at_the_ends_of_the_numbers(machine):
    ends = np.array([np.inf, -np.inf, np.nan, 0.0, -1.0, 800.0, -800.0, 1.0])
    with np.errstate(all="ignore"):
        of_one = ((ca.OP_EXP, np.exp), (ca.OP_LOG, np.log), (ca.OP_LOG1P, np.log1p), (ca.OP_TANH, np.tanh))
        for code, exact in of_one:
            assert run(machine, "many", code, ends, ends) == pytest.approx(
                exact(ends), abs=1e-300, nan_ok=True
            )


def test_sines_of_many_turns_lose_no_more_than_their_angle(machine):
    angles = np.linspace(-1e5, 1e5, 8000)
    for code, exact in ((ca.OP_SIN, np.sin), (ca.OP_COS, np.cos)):
        assert np.abs(run(machine, "many", code, angles, angles) - exact(angles)).max() < 1e-15


def test_powers_of_all_signs_and_ends(machine):
    x = np.array(
        [0.0, 0.0, 0.0, -2.0, -2.0, -2.0, -2.0, 1.0, np.inf, 2.0, -1.5, 0.3, np.nan, 2.0, 0.5, 1e-200]
    )
    y = np.array(
        [2.5, 0.0, -1.0, 3.0, 4.0, -3.0, 0.5, np.nan, 2.0, np.nan, 0.0, 40.0, 1.5, 2000.0, 2000.0, 0.1]
    )
    with np.errstate(all="ignore"):
        exact = np.power(x, y)
    assert run(machine, "many", ca.OP_POW, x, y) == pytest.approx(exact, rel=1e-13, abs=1e-300, nan_ok=True)


@njit
def moved(code, X, u, p, c, many, tolerance, h):
    """A step of LANES states together in place; its error."""
    call(code.constants, (at(p, 0), at(c, 0)))
    for i in range(code.hoisted):
        many[i] = c[i]
    held = np.repeat(u, LANES)
    return call(code.many_step, (at(X, 0), at(held, 0), at(many, 0), at(tolerance, 0), h))


@pytest.mark.parametrize("friction", ["bristle", "smooth"])
def test_states_that_move_together_move_as_alone(friction):
    model = build(servo_pneumatic, friction=friction)
    code, p = compiled_lanes(model).code, model.vector(read_rig(DATA / "table1.toml").parameters)
    alone, nx = rosenbrock(model), len(model.states)
    rng, c = np.random.default_rng(2), np.empty(code.hoisted)
    many = np.empty((code.hoisted, LANES))
    for _ in range(20):
        x = np.array(model.start(p)[0]).ravel() + 0.3 * model.scales * rng.uniform(-1, 1, (LANES, nx))
        u, X = rng.uniform(-1, 1, 1), np.ascontiguousarray(x.T)
        ends = np.array([np.array(alone(one, u, p, 1e-4, 0)).ravel() for one in x])
        error = moved(code, X, u, p, c, many, 1e9 * model.scales, 1e-4)
        assert error == pytest.approx(np.abs(ends[:, nx:] / (1e9 * model.scales)).max(), rel=1e-6)
        assert pytest.approx(ends[:, :nx], rel=1e-9, abs=1e-12) == X.T
        before = X.copy()
        assert moved(code, X, u, p, c, many, 1e-30 * model.scales, 1e-4) > 1.0
        assert np.array_equal(X, before)


def relay(s):
    """x' = -1000 sign x: at zero it never comes to rest."""
    x = s.state("position", "m", 1.0, start=100.0, spread=1e-3)
    s.rate(x, -1e3 * ca.sign(x) + 0.0 * s.input("command", "1"))
    s.output("position", "m", x)


def test_equations_that_need_ever_smaller_steps_are_given_up():
    model = build(relay)
    time = np.arange(30) / 100
    channels = {
        "command": Channel("command", "u", "1", np.zeros(30)),
        "position": Channel("position", "x", "m", np.full(30, np.nan)),
    }
    problem = build_problem(model, [Recording("run.csv", time, channels)], WHOLE)
    seen = run_filter(
        model, problem, model.vector({})[None], np.zeros((1, 1)), np.ones((1, 1)), keep=True
    )  # no process noise, no measurement
    before = time < 0.095
    assert seen.states[0][before, 0] == pytest.approx(100.0 - 1e3 * time[before], rel=1e-6)
    assert np.isinf(seen.innovations[0][time > 0.115]).all()
