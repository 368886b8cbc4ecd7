"""The wave that describes what has no name: its form, a phase for every recording, and that it is no candidate."""

from pathlib import Path

import numpy as np
import pytest

from optid.core.sheet import build
from optid.effects.library import admitted, find_effect
from optid.effects.wave import Wave
from optid.errors import PlantError, RigError
from optid.rigs.emps import emps
from optid.rigs.rigfile import read_rig, with_effects, write_rig

SIZE, HEIGHT, REPEATS, PHASE = 40.0, 0.7, 5.0, 0.4
EMPS = Path(__file__).parents[2] / "data" / "emps.toml"


def force(wave, states, clock=0.0):
    """What a wave adds to the axis' force, N: from what it does to the acceleration."""
    values = {
        f"{wave.name}.{name}": v for name, v in (("height", HEIGHT), ("repeats", REPEATS), ("phase", PHASE))
    }
    plain = read_rig(EMPS)
    full = with_effects(plain, [wave], values)
    rates = []
    for rig in (full, plain):
        x = [states.get(one.name.rpartition(".")[2], 0.0) for one in rig.model.states]
        u = [clock if port.role == "clock" else 0.0 for port in rig.model.inputs]
        row = [one.name for one in rig.model.states].index("velocity")
        rates.append(float(rig.model.rates(x, u, rig.model.vector(rig.parameters))[row]))
    return (rates[0] - rates[1]) * plain.parameters["mass"]


@pytest.mark.parametrize("position", [-0.13, 0.0, 0.2])
def test_over_a_position_it_is_a_sine(position):
    wave = Wave("force.external", "position", size=SIZE)
    expected = SIZE * HEIGHT * np.sin(2 * np.pi * REPEATS * position + PHASE)
    assert force(wave, {"position": position}) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("clock", [0.0, 0.33])
def test_over_time_a_recording_has_a_phase_and_an_amplitude_of_its_own(clock):
    wave = Wave("force.external", "time", size=SIZE)
    own = complex(np.exp(1j * PHASE)) + complex(-0.3, 0.8)  # sine and cosine as its real and imaginary part
    expected = SIZE * HEIGHT * (own * np.exp(2j * np.pi * REPEATS * clock)).imag
    assert force(wave, {"sine": -0.3, "cosine": 0.8}, clock) == pytest.approx(expected, rel=1e-9)


def test_it_is_found_by_its_name_and_is_no_candidate():
    for name in ("wave@force.external@time", "wave@force.external@position"):
        wave = find_effect(name, Path())
        assert (wave.name, wave.sites) == (name, ("force.external",))
    assert not any(effect.name.startswith("wave") for effect in admitted(build(emps)))
    with pytest.raises(RigError, match="wave"):
        find_effect("wave@force.external", Path())


def test_a_signal_that_the_plant_does_not_have_is_named():
    with pytest.raises(PlantError, match=r'no state or input "positon".*position'):
        build(emps, [Wave("force.external", "positon")])


def test_a_rig_file_states_all_of_its_numbers(tmp_path):
    wave = Wave("force.external", "time", repeats=3.0, size=SIZE)
    values = {f"{wave.name}.{q.name}": float(q.default) for q in wave.parameters}
    write_rig(with_effects(read_rig(EMPS), [wave]), tmp_path / "whole.toml", values)
    again = read_rig(tmp_path / "whole.toml")
    assert again.effects[0].name == wave.name
    assert again.parameters[f"{wave.name}.repeats"] == 3.0
    lines = (tmp_path / "whole.toml").read_text().splitlines(keepends=True)
    (tmp_path / "cut.toml").write_text("".join(line for line in lines if "phase" not in line))
    with pytest.raises(RigError, match="no value for phase"):
        read_rig(tmp_path / "cut.toml")


def test_while_it_is_fitted_a_wave_has_a_period_within_what_was_recorded():
    """One of 1e-9 Hz with a height of 1e7 is a slope, and says nothing of what repeats."""
    bounds = {q.name: q.bounds for q in Wave("force.external", "time", repeats=0.1, fewest=0.1).parameters}
    assert bounds["repeats"][0] == 0.1
    swelling = Wave("force.external", "time", repeats=0.1, fewest=0.1).swelling("velocity", 1.0)
    assert {q.name: q.bounds for q in swelling.sized(0.3, 1.0).parameters}["repeats"][0] == 0.1
