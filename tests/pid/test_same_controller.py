"""One definition, four languages: Python, CasADi, C and structured text give the same bits, in every situation."""

import ctypes
import math
import shutil
import subprocess

import numpy as np
import pytest

from optid.errors import InputError
from optid.pid import pid_step
from optid.pid.controller import AntiWindup, Controller, Gains, Notch, Settings
from optid.pid.export import c_header, structured_text
from optid.pid.symbolic import controller as symbolic_controller
from tests.pid.structured_text import Instance, Program

GAINS = Gains(60.0, 200.0, 1.0, 2e-3, 0.9, 0.3)
OTHER = Gains(35.0, 80.0, 0.4, 4e-3, 1.0, 0.0)
CASES = {
    "all at once": (GAINS, Settings(1e-3, -5, 5, 2000.0, -0.2, 0.3, 0.05, 0.01)),
    "no limits": (GAINS, Settings(1e-3)),
    "limits only": (GAINS, Settings(1e-3, -5, 4)),
    "back-calculation": (
        GAINS,
        Settings(1e-3, -1, 1, anti_windup=AntiWindup.BACK_CALCULATION, tracking_time=0.02),
    ),
    "no integral": (Gains(60.0, 0.0, 1.0), Settings(1e-3, -5, 5, rate=300.0)),
    "notch and feed-forward": (
        GAINS,
        Settings(
            1e-3, -5, 5, acceleration=0.02, friction=0.3, friction_speed=0.05, notch=Notch(150.0, 60.0, 0.1)
        ),
    ),
    "negative gains": (Gains(-60.0, -200.0, -1.0, 1e-3), Settings(2e-3, -5, 5, resolution=0.25)),
}
SAMPLES = 400


def signals(seed):
    """Set-points and measurements that drive a loop through its limits and back; a few samples are missing."""
    rng = np.random.default_rng(seed)
    setpoint = np.repeat(rng.uniform(-0.1, 0.1, SAMPLES // 40), 40)
    measured = np.cumsum(rng.normal(0, 3e-3, SAMPLES))
    measured[rng.integers(5, SAMPLES, 6)] = np.nan
    return setpoint, measured


def reference(gains, settings, setpoint, measured):
    """Commands of the Python controller: start from a standing command, change gains half-way."""
    controller = Controller(gains, settings)
    controller.reset(float(setpoint[0]), float(measured[0]), 0.4)
    out = []
    for n, (r, y) in enumerate(zip(setpoint, measured, strict=True)):
        if n == SAMPLES // 2:
            controller.change(OTHER)
        out.append(controller.step(r, y))
    return np.array(out)


@pytest.fixture(scope="module")
def compiled_c(tmp_path_factory):
    compiler = shutil.which("gcc") or shutil.which("clang") or shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler: the exported C is not run")
    folder = tmp_path_factory.mktemp("c")

    def build(controller, other):
        (folder / "one.h").write_text(c_header(controller, "one"))
        (folder / "two.h").write_text(c_header(other, "two"))
        (folder / "run.c").write_text("""
            #include "one.h"
            #include "two.h"
            void run(const double *r, const double *y, double standing, long n, double *out) {
                one_memory m;
                one_settings s = one_tuned, other;
                for (long i = 0; i < (long)(sizeof s / sizeof(double)); i++)
                    ((double *)&other)[i] = ((const double *)&two_tuned)[i];
                one_start(&s, &m, r[0], y[0], standing);
                for (long i = 0; i < n; i++) {
                    if (i == n / 2) { one_change(&s, &m, &other); s = other; }
                    out[i] = one_law(&s, &m, r[i], y[i]);
                }
            }""")
        target = folder / f"run{len(list(folder.glob('*.so')))}.so"
        flags = ["-O2", "-std=c99", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off", "-shared", "-fPIC"]
        subprocess.run([compiler, *flags, folder / "run.c", "-o", target, "-lm"], check=True)
        return ctypes.CDLL(str(target)).run

    return build


@pytest.mark.parametrize("case", CASES)
def test_c(case, compiled_c):
    gains, settings = CASES[case]
    setpoint, measured = signals(1)
    out, pointer = np.empty(SAMPLES), ctypes.POINTER(ctypes.c_double)
    run = compiled_c(Controller(gains, settings), Controller(OTHER, settings))
    run(
        setpoint.ctypes.data_as(pointer),
        measured.ctypes.data_as(pointer),
        ctypes.c_double(0.4),
        ctypes.c_long(SAMPLES),
        out.ctypes.data_as(pointer),
    )
    np.testing.assert_array_equal(out, reference(gains, settings, setpoint, measured))


@pytest.mark.parametrize("case", CASES)
def test_structured_text(case):
    gains, settings = CASES[case]
    setpoint, measured = signals(2)
    block = Instance(Program(structured_text(Controller(gains, settings), "axis")), "axis")
    wanted = Instance(Program(structured_text(Controller(OTHER, settings), "axis")), "axis").scope["s"]
    assert block(enable=False, standing=0.4) == 0.4
    out = [
        block(
            enable=True,
            setpoint=float(r),
            measured=float(y),
            standing=0.4,
            wanted=wanted,
            apply=n == SAMPLES // 2,
        )
        for n, (r, y) in enumerate(zip(setpoint, measured, strict=True))
    ]
    np.testing.assert_array_equal(out, reference(gains, settings, setpoint, measured))


@pytest.mark.parametrize("case", CASES)
def test_casadi(case):
    gains, settings = CASES[case]
    setpoint, measured = signals(3)
    measured = np.nan_to_num(measured)
    function, controller = symbolic_controller(), Controller(gains, settings)
    memory = controller.state
    for r, y in zip(setpoint, measured, strict=True):
        command, memory = function(controller.vector, memory, r, y)
        assert float(command) == controller.step(float(r), float(y))
    np.testing.assert_array_equal(np.array(memory).ravel(), controller.state)


def test_casadi_gradient_is_that_of_the_command():
    """Away from kinks, the derivative to every gain equals central differences."""
    import casadi as ca

    function = symbolic_controller()
    s, m = ca.SX.sym("s", pid_step.SETTINGS), ca.SX.sym("m", pid_step.MEMORY)
    slope = ca.Function("slope", [s, m], [ca.jacobian(function(s, m, 0.06, 0.01)[0], s)])
    vector = Controller(GAINS, Settings(1e-3, -50, 50)).vector
    memory = np.array([0.3, -0.5, 0.2, 0.05, 0.012, 0.1, 0.02, -0.03])
    exact = np.array(slope(vector, memory)).ravel()[: pid_step.GAINS]
    for i in range(pid_step.GAINS):
        h = 1e-6 * max(abs(vector[i]), 1e-3)
        up, down = vector.copy(), vector.copy()
        up[i] += h
        down[i] -= h
        change = float(function(up, memory, 0.06, 0.01)[0] - function(down, memory, 0.06, 0.01)[0]) / (2 * h)
        assert exact[i] == pytest.approx(change, rel=1e-6, abs=1e-9)


def test_interpreter_refuses_what_is_no_structured_text():
    with pytest.raises(AssertionError):
        Program("FUNCTION_BLOCK x VAR a : LREAL; END_VAR a = 1.0; END_FUNCTION_BLOCK")
    with pytest.raises(AssertionError):
        Program("FUNCTION_BLOCK x VAR a : LREAL; a : LREAL; END_VAR END_FUNCTION_BLOCK")


def test_names_are_checked():
    controller = Controller(GAINS, Settings(1e-3))
    for bad in ("2nd", "Axis", "a-b", ""):
        with pytest.raises(InputError):
            c_header(controller, bad)
        with pytest.raises(InputError):
            structured_text(controller, bad)


def test_no_infinity_reaches_a_file():
    text = c_header(Controller(GAINS, Settings(1e-3))) + structured_text(Controller(GAINS, Settings(1e-3)))
    assert "inf" not in text.lower().replace("#ifndef", "")
    assert math.isfinite(float("1.0E308"))
