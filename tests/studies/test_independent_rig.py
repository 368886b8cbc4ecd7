"""The independent rig: energy and air balance, it sticks truly, agrees with other equations, repeats."""

import ast
from pathlib import Path

import numpy as np
import pytest

from studies import independent_rig, make_recording
from studies.independent_rig import Controller, Rig, Sensors, balanced, orifice, recording, replay, simulate
from studies.independent_rig.states import V, X
from studies.peers import axis
from studies.references import REFERENCES, mixed, ramps

RIG = Rig()
IDLE = Controller(kp=0.0, ki=0.0, kd=0.0)
QUIET = Sensors(position_noise=0.0, pressure_noise=0.0)
AREA_A = np.pi / 4 * RIG.bore**2
AREA_ROD = np.pi / 4 * RIG.rod**2
AREA_B = AREA_A - AREA_ROD


def volumes(run):
    length = RIG.stroke / 2 + RIG.residual_length
    return AREA_A * (length + run.position), AREA_B * (length - run.position)


@pytest.fixture(scope="module")
def bounce():
    """Closed valve, A at 6 bar and B at 4 bar: the piston swings on its air springs until it sticks."""
    rng = np.random.default_rng(0)
    return simulate(
        RIG, np.zeros(3000), rng, controller=IDLE, sensors=QUIET, dt=1e-4, start=(0.0, 0.0, 6e5, 4e5)
    )


def test_it_imports_nothing_of_optid():
    package = Path(independent_rig.__file__).parent
    beside = [package.parent / name for name in ("references.py", "make_recording.py")]
    files = [*sorted(package.glob("*.py")), *beside]
    assert len(files) > 8
    for path in files:
        tree = ast.parse(path.read_text())
        modules = [n.module or "" for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)]
        modules += [a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names]
        assert not [name for name in modules if name.split(".")[0] == "optid"]


def test_closed_chambers_are_adiabatic(bounce):
    for pressure, volume in zip((bounce.pressure_a, bounce.pressure_b), volumes(bounce), strict=True):
        assert np.ptp(np.log(pressure * volume**RIG.heat_ratio)) < 1e-9


def test_friction_takes_what_motion_and_air_lose(bounce):
    v, dt = bounce.velocity, 1e-4
    inner = sum(
        p * volume / (RIG.heat_ratio - 1)
        for p, volume in zip((bounce.pressure_a, bounce.pressure_b), volumes(bounce), strict=True)
    )
    stored = inner + RIG.mass * v**2 / 2 + RIG.atmospheric_pressure * AREA_ROD * bounce.position
    loss = RIG.viscous * v**2 + RIG.coulomb * np.abs(v)
    lost = np.concatenate([[0.0], np.cumsum((loss[1:] + loss[:-1]) / 2 * dt)])
    assert lost[-1] > 4.0  # joules: something happens
    assert np.abs(stored + lost - stored[0]).max() < 2e-3


def test_it_sticks_truly_and_within_the_band(bounce):
    still = bounce.stuck[-2000:]
    assert still.all()
    assert np.ptp(bounce.position[-2000:]) == 0.0
    assert np.all(bounce.velocity[bounce.stuck] == 0.0)
    force = AREA_A * bounce.pressure_a - AREA_B * bounce.pressure_b - AREA_ROD * RIG.atmospheric_pressure
    assert np.abs(force[bounce.stuck]).max() <= RIG.coulomb * (1 + 1e-12)


def test_slow_ramps_stick_and_slip():
    rng = np.random.default_rng(2)
    run = simulate(RIG._replace(stick_ratio=1.5), ramps(4.0, 1e-3, rng), rng)
    assert 0.2 < run.stuck.mean() < 0.95
    assert np.abs(run.velocity).max() > 0.02


def test_choked_orifice_follows_its_constant():
    # sqrt(K (2/(K+1))^((K+1)/(K-1)) / R) = 0.040418 for air: 0.8 * 24.8 mm2 * 7 bar * 0.040418 / sqrt(293).
    flow = orifice(RIG, 24.8e-6, 7e5, 1e5)
    assert flow == pytest.approx(0.8 * 24.8e-6 * 7e5 * 0.040418 / np.sqrt(293), rel=2e-5)
    assert orifice(RIG, 24.8e-6, 7e5, 3.6e5) == pytest.approx(flow, rel=1e-12)
    assert orifice(RIG, 24.8e-6, 7e5, 7e5) == 0.0


def test_the_rig_at_rest_stays_at_rest():
    run = simulate(RIG, np.zeros(200), np.random.default_rng(0), controller=IDLE, sensors=QUIET)
    assert np.all(run.position == 0.0)
    assert run.pressure_a == pytest.approx(balanced(RIG)[2], rel=1e-12)


def test_steps_are_fine_enough():
    reference = mixed(3.0, 1e-3, np.random.default_rng(3))
    coarse, fine = (simulate(RIG, reference, np.random.default_rng(1), step=h) for h in (1e-5, 2e-6))
    assert np.abs(coarse.position - fine.position).max() < 1e-9


def test_sliding_agrees_with_smooth_equations_written_elsewhere():
    """While it slides one way, a narrow tanh and a narrow laminar region are the same physics."""
    n, start = 60, (-0.05, 0.3, 5e5, 4e5)
    drive = Controller(kp=1.0, ki=0.0, kd=0.0, limit=1.0, quantum=1e-12)
    reference = np.full(n, 0.5)
    run = simulate(RIG, reference, np.random.default_rng(0), controller=drive, sensors=QUIET, start=start)
    assert run.velocity.min() > 0.05
    p = {**axis.TRUE, "friction_width": 1e-3, "flow_width": 1e-7}
    other = axis.simulate(p, start, run.command, 1e-3, rtol=1e-9)[:n]
    assert np.abs(run.position - other[:, 0]).max() < 1e-8
    assert np.abs(run.pressure_a - other[:, 2]).max() < 5.0


def test_the_stroke_ends_hold():
    push = Controller(kp=1.0, ki=0.0, kd=0.0, limit=5.0)
    run = simulate(RIG, np.full(600, 9.0), np.random.default_rng(0), controller=push, sensors=QUIET)
    assert run.position[-1] == pytest.approx(RIG.stroke / 2)
    assert run.position.max() <= RIG.stroke / 2
    assert run.velocity[-1] == 0.0


def test_the_same_seed_gives_the_same_table():
    def table(seed):
        rng = np.random.default_rng(seed)
        return recording(simulate(RIG, mixed(1.0, 1e-3, rng), rng), rng)

    assert table(4).equals(table(4))
    assert not table(4).equals(table(5))
    assert list(table(4).columns) == ["t", "u", "x", "r", "pa", "pb"]


@pytest.mark.parametrize("colour", [0.0, 0.9])
def test_noise_has_its_size_and_colour(colour):
    noise = independent_rig.unit_noise(20000, colour, np.random.default_rng(6))
    assert noise.std() == pytest.approx(1.0, abs=0.05)
    assert np.corrcoef(noise[1:], noise[:-1])[0, 1] == pytest.approx(colour, abs=0.03)


def test_commands_stand_on_the_converters_grid():
    rng = np.random.default_rng(7)
    run = simulate(RIG, mixed(1.0, 1e-3, rng), rng)
    codes = run.command / Controller().quantum
    assert np.abs(codes - np.round(codes)).max() < 1e-9
    assert np.abs(run.command).max() <= 5.0


@pytest.mark.parametrize("name", REFERENCES)
def test_references_have_their_length_and_reach(name):
    path = REFERENCES[name](2.0, 1e-3, np.random.default_rng(8), 0.1)
    assert path.shape == (2000,)
    assert np.abs(path).max() <= 0.1


def test_the_recordings_in_data_are_those_of_the_script(tmp_path):
    make_recording.main(tmp_path)
    data = Path(make_recording.__file__).parents[1] / "data"
    for name in make_recording.RUNS:
        made, kept = (np.loadtxt(folder / name, delimiter=",", skiprows=1) for folder in (tmp_path, data))
        assert made == pytest.approx(
            kept, abs=3e-3
        )  # a quantum of the command; other machines round otherwise
    assert (tmp_path / "bench_truth.json").read_text() == (data / "bench_truth.json").read_text()


BEYOND = {
    "spool": {"valve_order": 1.0},
    "second-order spool": {"valve_order": 2.0, "valve_frequency": 200.0},
    "wall heat": {"wall_heat": 60.0},
    "reservoir": {"reservoir": 1e-3},
    "silencer": {"silencer": 1e-5},
    "sensor filter": {"sensor_order": 2.0},
    "coupled load": {"load_share": 0.5, "load_stiffness": 5e4, "load_damping": 30.0},
    "elastic contact": {"presliding": 1e-4},
}


@pytest.mark.full
@pytest.mark.parametrize("name", BEYOND)
def test_physics_beyond_the_base_moves_on_and_bends_the_path_a_little(name):
    """Every element with states of its own: the axis still follows, neither frozen nor left as it was."""
    reference = mixed(3.0, 1e-3, np.random.default_rng(3))
    plain, other = (
        simulate(rig, reference, np.random.default_rng(1), step=5e-5)
        for rig in (RIG, RIG._replace(**BEYOND[name]))
    )
    off = np.abs(other.position - plain.position).max()
    assert 1e-5 < off < 0.05
    assert np.ptp(other.position[-1000:]) > 5e-3


def test_the_memoryless_states_replay_the_loop():
    """The rig alone, from any sample's state with the recorded command, goes where it went in the loop."""
    reference = mixed(2.0, 1e-3, np.random.default_rng(3))
    rig = RIG._replace(valve_order=2.0, delay=3e-3, backlash=1e-4, valve_hysteresis=0.01)
    run = simulate(rig, reference, np.random.default_rng(1), step=5e-5)
    states, clean = replay(rig, run.command / 5.0, run.states[700], 700, 500, step=5e-5)
    assert states == pytest.approx(run.states[700:1200], abs=1e-12, rel=1e-12)
    assert clean == pytest.approx(run.clean[700:1200], abs=1e-15)


@pytest.mark.parametrize("yielding", [2e-6, 1e-4])
def test_an_elastic_contact_is_damped_far_below_critical(yielding):
    """Struck within its yield it swings through: critically damped it would come back to rest from one side."""
    rig = RIG._replace(presliding=yielding)
    start = simulate(rig, np.zeros(2), np.random.default_rng(0), controller=IDLE, sensors=QUIET).states[0]
    frequency = np.sqrt(
        rig.coulomb / (yielding * rig.mass)
    )  # rad/s, but for the spread of the elements' yields
    start[V] = 0.1 * yielding * frequency
    states, _ = replay(rig, np.zeros(400), start, 0, 400, step=0.005 / frequency, dt=0.05 / frequency)
    swing = states[:, X] - states[-1, X]
    assert swing.min() < -0.3 * swing.max()


@pytest.mark.parametrize("yielding", [4e-6, 1e-4])
def test_an_elastic_contact_that_slides_resists_as_a_rigid_one(yielding):
    """From the force balance along an open-loop run: air less mass times acceleration is Coulomb's force."""
    rig = RIG._replace(presliding=yielding)
    start = simulate(rig, np.zeros(2), np.random.default_rng(0), controller=IDLE, sensors=QUIET).states[0]
    states, _ = replay(rig, np.full(80, 0.3), start, 0, 80, step=2e-5)
    x, v, a, b = states[:, :4].T
    assert x[-1] > 0.05
    air = AREA_A * a - AREA_B * b - AREA_ROD * rig.atmospheric_pressure - rig.viscous * v
    friction = air - rig.mass * np.gradient(v, 1e-3)
    assert friction[20:70] == pytest.approx(rig.coulomb, rel=0.02)
