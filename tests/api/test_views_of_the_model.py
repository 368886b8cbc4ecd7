"""The model as other tools see it: CasADi functions, python-control systems, an FMU."""

import shutil
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import optid
from optid.core.simulation import simulate
from optid.effects.library import admitted
from optid.errors import InputError
from optid.rigs.rigfile import with_effects

DATA = Path(__file__).parents[2] / "data"
DT, STEPS, COMMAND = 1e-3, 120, 0.3


@pytest.fixture(scope="module")
def rig():
    return optid.read_rig(DATA / "bench.toml")


def start(rig):
    return np.array(rig.model.start(rig.model.vector(rig.parameters))[0]).ravel()


def run(rig):
    p, inputs = rig.model.vector(rig.parameters), np.full((STEPS + 1, 1), COMMAND)
    return simulate(rig.model, p, start(rig), np.full(STEPS + 1, DT), inputs)


def test_casadi_functions_have_names_and_units_and_step_as_optid_simulates(rig):
    f = rig.model.to_casadi()
    assert list(f.states) == ["position", "velocity", "pressure_a", "pressure_b", "bristle"]
    assert (f.states["pressure_a"], f.inputs, f.y["position"]) == ("Pa", {"command": "1"}, "m")
    assert "coulomb_friction (N)" in str(f)
    p, x = f.values(rig.parameters), start(rig)
    assert p[list(f.parameters).index("bore_diameter")] == 0.042
    for _ in range(STEPS):
        x = f.step(x, COMMAND, p, DT)
    there = run(rig).states[0, -1]
    assert np.abs(np.array(x).ravel() - there)[:4] / rig.model.scales[:4] == pytest.approx(0.0, abs=1e-4)
    assert float(f.outputs(x, COMMAND, p)[0]) == pytest.approx(there[0], rel=1e-5)


def test_casadi_functions_can_be_derived_by_users(rig):
    f = rig.model.to_casadi(substeps=2)
    x, u, p = ca.MX.sym("x", 5), ca.MX.sym("u"), f.values(rig.parameters)
    slope = ca.Function("slope", [x, u], [ca.jacobian(f.step(x, u, p, DT), u)])
    assert float(slope(start(rig), COMMAND)[2]) > 0  # air flows into chamber A
    with pytest.raises(InputError, match="at least 1"):
        rig.model.to_casadi(substeps=0)


def test_a_step_in_which_the_command_comes_late_takes_both_halves(rig):
    late = next(effect for effect in admitted(rig.model) if effect.name == "input_delay")
    slow = with_effects(rig, [late], {"input_delay.delay": 0.4e-3})
    assert slow.model.halves is not None
    f = slow.model.to_casadi()
    p, before, now = f.values(slow.parameters), 0.0, COMMAND
    given = {"command": now, "interval": DT}
    u = [given.get(name, before) for name in f.inputs]
    x = np.array(f.step(start(slow), u, p, DT)).ravel()
    at_once = np.array(
        rig.model.to_casadi().step(start(rig), now, rig.model.vector(rig.parameters), DT)
    ).ravel()
    moved, whole = x[2] - start(slow)[2], at_once[2] - start(rig)[2]
    assert 0.5 * whole < moved < 0.7 * whole  # air flows in for 0.6 ms of the step


def test_an_axis_that_slides_has_a_clean_linear_model_and_one_at_rest_says_what_it_is(rig):
    sliding = rig.model.to_control(
        rig.parameters, {"position": 0.0, "velocity": 0.2}, ("position",), near={"command": 0.1}
    )
    assert sliding.note == ""
    assert list(sliding.system.state_labels) == [state.name for state in rig.model.states]
    assert sliding.system.output_labels[0] == "position" and sliding.rates["position"] == pytest.approx(0.2)
    resting = rig.model.to_control(rig.parameters, {"position": 0.0, "velocity": 0.0, "command": 0.0})
    assert resting.elastic == ("bristle",) and "Friction holds" in resting.note and "command" in resting.note


def test_a_system_of_python_control_goes_into_a_model_and_comes_back():
    import control

    system = control.tf([2e-5, 1.9e-5], [1, -1.9, 0.9], 1e-3, name="axis")
    made = optid.from_control(system, noise=2e-5)
    assert (made.input_unit, made.output_unit, made.chosen.noise_variance) == ("V", "m", pytest.approx(4e-10))
    turn = np.array([1.0, 30.0, 500.0])
    assert made.chosen.transfer_function()(np.exp(1j * turn * 1e-3)) == pytest.approx(
        system(np.exp(1j * turn * 1e-3))
    )
    assert "axis" in made.words
    with pytest.raises(InputError, match="sample time"):
        optid.from_control(control.tf([1], [1, 1]))
    with pytest.raises(InputError, match="one of each"):
        optid.from_control(control.ss([[0.5]], [[1.0, 1.0]], [[1.0]], [[0.0, 0.0]], 1e-3))


@pytest.fixture(scope="module")
def fmu(rig, tmp_path_factory):
    pytest.importorskip("fmpy")
    if not any(map(shutil.which, ("cc", "gcc", "clang"))):
        pytest.skip("no C compiler on this machine")
    return optid.export_fmu(rig, tmp_path_factory.mktemp("fmu") / "axis.fmu")


def test_an_fmu_is_sound_and_moves_as_optid_simulates(rig, fmu):
    import fmpy
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(fmu)) == []
    signal = np.array([(0.0, COMMAND), (1.0, COMMAND)], dtype=[("time", float), ("command", float)])
    found = fmpy.simulate_fmu(
        str(fmu),
        stop_time=STEPS * DT,
        input=signal,
        output=["position", "pressure_a"],
        output_interval=DT,
        solver="CVode",
        relative_tolerance=1e-8,
    )
    there = run(rig).outputs[0]
    assert np.abs(found["position"] - there[: len(found), 0]).max() < 1e-8
    assert found["pressure_a"][-1] == pytest.approx(there[len(found) - 1, 1], rel=1e-5)


def test_an_fmu_of_what_it_cannot_hold_is_refused(rig, tmp_path):
    late = next(effect for effect in admitted(rig.model) if effect.name == "input_delay")
    with pytest.raises(InputError, match="only the present command"):
        optid.export_fmu(with_effects(rig, [late], {"input_delay.delay": 0.4e-3}), tmp_path / "axis.fmu")
    with pytest.raises(InputError, match='no state "speed"'):
        optid.export_fmu(rig, tmp_path / "axis.fmu", start={"speed": 0.1})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.full
def test_the_example_on_casadi_reaches_its_stroke(tmp_path):
    from studies.casadi_stroke import STROKE, replay, smooth_rig, solve

    rig = smooth_rig(tmp_path)
    command, position = solve(rig)
    assert np.abs(command).max() <= 1.0 + 1e-6
    assert position[-1] == pytest.approx(STROKE, abs=1e-6)
    assert replay(rig, command) == pytest.approx(STROKE, abs=5e-4)
    assert replay(replace(rig), 0.5 * command) < 0.9 * STROKE
