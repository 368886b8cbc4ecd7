"""The rivals of the speed benchmark: the plant's equations, agreement with SciPy, a fit that is right."""

import numpy as np
import pytest

from optid.core.sheet import build
from optid.rigs.servo_pneumatic import servo_pneumatic
from studies.benchmark_fit import rig_and_recording
from studies.peers import axis, fit_c, fit_casadi, fit_scipy, record

needs_gcc = pytest.mark.skipif(not fit_c.available(), reason="needs gcc")


@pytest.fixture(scope="module")
def short():
    return record.benchmark_record(seconds=1.0)


def test_equations_are_those_of_the_plant():
    model = build(servo_pneumatic, friction="smooth")
    p = model.vector(axis.TRUE)
    rng = np.random.default_rng(5)
    for _ in range(200):
        y = [rng.uniform(-0.131, 0.131), rng.normal(0, 0.5), *rng.uniform(0.8e5, 7.5e5, 2)]
        u = rng.uniform(-1, 1)
        plant = np.array(model.rates(y, [u], p)).ravel()
        assert axis.rates(0.0, y, u, axis.TRUE) == pytest.approx(plant, rel=1e-9, abs=1e-9)


@needs_gcc
def test_c_agrees_with_radau(short):
    n = 250
    reference = axis.simulate(short.truth, short.start_state, short.share[:n], short.dt)
    run = fit_c.simulate(short.truth, short.start_state, short.share[:n], short.dt, steps=20)
    assert np.abs(run - reference).max(axis=0) == pytest.approx(0, abs=1e-3)  # pascals
    assert np.abs(run - reference)[:, 0].max() < 1e-10  # metres


@needs_gcc
def test_steps_of_half_a_millisecond_are_fine_enough(short):
    run = fit_c.simulate(short.truth, short.start_state, short.share[:-1], short.dt, steps=2)
    assert np.abs(run[:, 0] - short.states[:, 0]).max() < 0.2e-6


@needs_gcc
def test_stops_hold_the_piston():
    run = fit_c.simulate(axis.TRUE, [0.12, 0.0, 4e5, 4e5], np.full(400, 0.2), 1e-3, 20)
    reference = axis.simulate(axis.TRUE, [0.12, 0.0, 4e5, 4e5], np.full(400, 0.2), 1e-3, rtol=1e-9)
    assert 0.13 < run[-1, 0] < 0.1305
    assert np.abs(run - reference)[:, 0].max() < 1e-6


@needs_gcc
def test_fit_finds_the_truth_and_repeats():
    full = record.benchmark_record()
    found = fit_c.fit(full.guess, full.start_state, full.share, full.position, full.dt)
    assert found.converged
    assert found.passes < 12
    for name in axis.FREE:
        assert found.parameters[name] == pytest.approx(full.truth[name], rel=2e-3)
    assert np.sqrt(found.cost / len(full.position)) == pytest.approx(record.NOISE, rel=0.02)
    assert found == fit_c.fit(full.guess, full.start_state, full.share, full.position, full.dt)


@needs_gcc
def test_scipy_reaches_the_same_minimum(short):
    n = 600
    near = {**short.truth, "viscous_friction": 85.0, "coulomb_friction": 80.0}
    data = (short.start_state, short.share[:n], short.position[:n], short.dt)
    c, scipy = fit_c.fit(near, *data), fit_scipy.fit(near, *data, rtol=1e-8)
    assert scipy.cost == pytest.approx(c.cost, rel=1e-3)


@needs_gcc
def test_c_leaves_denormal_numbers_alone(short):
    fit_c.fit(short.guess, short.start_state, short.share, short.position, short.dt, most=2)
    assert np.nextafter(0.0, 1.0) * 1.0 > 0.0


@needs_gcc
def test_casadi_and_ipopt_find_the_truth_from_the_same_start(short):
    rig, _ = rig_and_recording(short)
    found = fit_casadi.fit(rig, short.start_state, short.share, short.position, short.dt)
    assert found.outcome == "Solve_Succeeded"
    for name in axis.FREE:
        assert found.parameters[name] == pytest.approx(axis.TRUE[name], rel=0.02)
