"""Every CasADi instruction that has a compiled form, its slopes, and its place among the constants, against CasADi."""

import casadi as ca
import numpy as np
import pytest
from numba import njit

from optid.core.instructions import FORMS
from optid.core.jit import compiled
from optid.core.kernel import at, call
from optid.core.parameter import Parameter
from optid.core.sheet import build

OF_ONE = {
    "exp": ca.exp,
    "log": lambda a: ca.log(a * a),
    "log1p": lambda a: ca.log1p(a * a),
    "expm1": ca.expm1,
    "sqrt": lambda a: ca.sqrt(a * a + 1),
    "sin": ca.sin,
    "cos": ca.cos,
    "tan": ca.tan,
    "atan": ca.atan,
    "asin": lambda a: ca.asin(a / 9),
    "acos": lambda a: ca.acos(a / 9),
    "sinh": ca.sinh,
    "cosh": ca.cosh,
    "tanh": ca.tanh,
    "erf": ca.erf,
    "fabs": ca.fabs,
    "sign": ca.sign,
    "floor": ca.floor,
    "ceil": ca.ceil,
    "inverse": lambda a: 1 / a,
    "twice": lambda a: a + a,
    "square": lambda a: a * a,
    "negative": lambda a: -a,
    "power": lambda a: (a * a) ** 1.7,
    "not": lambda a: ca.logic_not(a > 0.5),
}
OF_TWO = {
    "plus": lambda a, b: a + b,
    "minus": lambda a, b: a - b,
    "times": lambda a, b: a * b,
    "over": lambda a, b: a / b,
    "pow": lambda a, b: (a * a) ** b,
    "atan2": ca.atan2,
    "fmod": ca.fmod,
    "fmin": ca.fmin,
    "fmax": ca.fmax,
    "below": lambda a, b: a < b,
    "at most": lambda a, b: a <= b,
    "equal": lambda a, b: ca.eq(a, b),
    "unequal": lambda a, b: ca.ne(a, b),
    "and": lambda a, b: ca.logic_and(a > 0, b > 0),
    "or": lambda a, b: ca.logic_or(a > 0, b > 0),
    "either": lambda a, b: ca.if_else(a > b, a * b, a - b),
}
ONE = Parameter("one", "1", 1.0, "a number", "a test", bounds=(-10.0, 10.0))
OTHER = Parameter("other", "1", 1.0, "a number", "a test", bounds=(-10.0, 10.0))
POINTS = [(1.3, 0.7), (-1.3, 0.7), (0.4, -2.2), (-2.5, -2.5), (3.0, 3.0), (0.2, 1e-9)]


def everything(s):
    """Every instruction of two states, of two parameters, and of one each."""
    a, b = s.state("a", "1", 1.0), s.state("b", "1", 1.0)
    p, q = s.param(ONE), s.param(OTHER)
    s.rate(a, b)
    s.rate(b, s.input("push", "1"))
    for kind, x, y in (("states", a, b), ("parameters", p, q), ("both", a, q)):
        for name, form in OF_ONE.items():
            s.output(f"{name} of {kind}", "1", form(x))
        for name, form in OF_TWO.items():
            s.output(f"{name} of {kind}", "1", form(x, y))


@njit
def sensed(code, x, S, u, p, c, y, R):
    call(code.constants, (at(p, 0), at(c, 0)))
    call(code.sensor_slopes, (at(x, 0), at(S, 0), at(u, 0), at(c, 0), at(y, 0), at(R, 0)))


@pytest.fixture(scope="module")
def model():
    return build(everything)


def test_values_and_slopes_are_casadis(model):
    machine = compiled(model, (0, 1))
    x, u, p = (ca.SX.sym(name, n) for name, n in (("x", 2), ("u", 1), ("p", 2)))
    values = model.sensors(x, u, p)
    exact = ca.Function("exact", [x, u, p], [values, ca.jacobian(values, ca.vertcat(x, p))])
    n, names = values.numel(), [port.role for port in model.outputs]
    c, y, R = np.empty(machine.code.hoisted), np.empty(n + 1), np.empty((n, machine.width))
    S = np.eye(2, machine.width)
    for point in POINTS:
        for constants in POINTS:
            at_x, at_p = np.array(point), np.array(constants)
            sensed(machine.code, at_x, S, np.zeros(1), at_p, c, y, R)
            right, slopes = (np.array(part.full()) for part in exact(at_x, 0.0, at_p))
            for i, name in enumerate(names):
                assert y[i] == pytest.approx(right[i, 0], rel=1e-12, abs=1e-12, nan_ok=True), (
                    name,
                    point,
                    constants,
                )
                expected = pytest.approx(slopes[i], rel=1e-9, abs=1e-12, nan_ok=True)
                assert R[i, :4] == expected, (name, point, constants)


def test_no_form_goes_untested(model):
    x, u, p = (ca.SX.sym(name, n) for name, n in (("x", 2), ("u", 1), ("p", 2)))
    values = model.sensors(x, u, p)
    function = ca.Function("all", [x, u, p], [values, ca.jacobian(values, ca.vertcat(x, p))])
    used = {function.instruction_id(k) for k in range(function.n_instructions())}
    assert set(FORMS) - used <= {ca.OP_ASSIGN}


def test_an_unused_branch_may_be_nan():
    def branches(s):
        x = s.state("x", "1", 1.0)
        s.rate(x, 0 * x)
        s.output("root", "1", ca.if_else(x > 0, ca.sqrt(x), -x))

    machine = compiled(build(branches))
    y, R, S = np.empty(2), np.empty((1, machine.width)), np.eye(1, machine.width)
    for x, value, slope in ((4.0, 2.0, 0.25), (-4.0, 4.0, -1.0)):
        c = np.empty(machine.code.hoisted)
        sensed(machine.code, np.array([x]), S, np.zeros(1), np.zeros(1), c, y, R)
        assert (y[0], R[0, 0]) == (value, slope)
