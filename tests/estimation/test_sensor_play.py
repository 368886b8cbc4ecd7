"""Where a sensor has errors of its own no output is a state: the first guess reads the state through the sensor."""

import casadi as ca
import numpy as np
import pytest

from optid.core.readers import read_recording
from optid.core.sheet import build
from optid.diagnosis.problem import prepare
from optid.effects.library import admitted
from optid.estimation.initial_trajectory import _states_behind_sensors, guess
from optid.estimation.moving_horizon import predict_windows
from optid.estimation.objective import objective_of
from optid.estimation.prediction import PROCESS_NOISE
from optid.estimation.problem import build_problem
from optid.rigs.rigfile import read_rig, with_effects
from studies.independent_axes.loop import table
from studies.trial.other_axes import BOARDS, DATA, Concealed, simulated

SD = 3e-4
FIELDS = {"backlash": 2.96e-3, "coulomb": 0.0976, "inertia": 4.48e-3, "mass": 0.49, "viscous": 0.0534}
FITTED = {
    "payload_mass": 0.4899,
    "load_inertia": 4.489e-3,
    "viscous_friction": 0.05347,
    "coulomb_friction": 0.09759,
    "presliding_length": 9.042e-5,
    "presliding_shape": 0.08814,
    "bristle_damping": 0.01238,
    "bristle_fading": 0.02,
    "sampling_skew": -7.602e-6,
    "sensor_backlash.play": 2.994e-3,
}


@pytest.fixture(scope="module")
def axis(tmp_path_factory):
    """Three seconds of the independent rotary axis with a play at its sensor, and a model that has it, too."""
    file = tmp_path_factory.mktemp("play") / "mixed.csv"
    rotary = BOARDS["rotary-axis"].rig._replace(**FIELDS)
    case = Concealed("case", "single", "sensor_backlash", "sensor", "large", FIELDS, 1)
    table(simulated(rotary, case, 3, 3.0), rotary).to_csv(file, index=False)
    plain = read_rig(DATA / "rotary_axis.toml")
    plain, (recording,) = prepare(plain, [read_recording(file, rig=plain)])
    play = next(effect for effect in admitted(plain.model) if effect.name == "sensor_backlash")
    rig = with_effects(plain, (play,), {"sensor_backlash.play": FITTED["sensor_backlash.play"]})
    return rig, recording, rig.model.vector({**rig.parameters, **FITTED})


def test_a_position_is_read_through_the_play_of_its_sensor(axis):
    rig, recording, p = axis
    problem = build_problem(rig.model, [recording], 0.5)
    names = [state.name for state in rig.model.states]
    off = guess(rig.model, problem, p)[:, names.index("position")] - problem.measured[problem.begins, 0]
    assert np.abs(off).max() < 5 * SD and np.abs(problem.measured[problem.begins, 0]).max() > 0.1


def test_the_first_windows_behind_a_play_are_predicted_to_the_noise(axis):
    """From a position of 0 their errors were 1124, 644, 229 and 73 times the noise."""
    rig, recording, p = axis
    problem = build_problem(rig.model, [recording], 0.5)
    objective, _ = objective_of(rig, (), problem)
    off = problem.measured - predict_windows(objective, p, PROCESS_NOISE * rig.model.scales).outputs
    errors = [
        np.sqrt(np.mean(off[begin : begin + count, 0] ** 2))
        for begin, count in zip(problem.begins, problem.counts, strict=True)
    ]
    assert max(errors[1:]) < 1.5 * SD


@pytest.mark.parametrize(("sensor", "shown"), [(ca.sqrt, ()), (lambda h: 0.5 + 2.0 * h, ((0, 0, 2.0, 0.5),))])
def test_only_a_sensor_that_is_linear_in_its_state_tells_a_guess(sensor, shown):
    """A root followed along its tangent would give a level below zero."""

    def tank(s):
        level = s.state("level", "m", 1.0, spread=1.0)
        s.rate(level, s.input("command", "1") - level)
        s.output("depth", "m", sensor(level))

    assert _states_behind_sensors(build(tank)) == shown
