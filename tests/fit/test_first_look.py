"""A first look: where a record begins, of what no sensor sees, on plants whose start is known."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from optid.core.recording import Channel, Recording
from optid.core.sheet import build
from optid.fit.first_look import NARROW, PARTS, _spread, first_look
from optid.fit.likelihood import WHOLE, Noise, deviance, run_filter, start_of
from optid.fit.problem import pose
from optid.rigs.rigfile import read_rig
from studies.independent_rig import Controller, Sensors
from studies.trial.case import Case
from studies.trial.record import RIG, record

SD, DT, SPREAD = 1e-4, 1e-3, 1.5
NOISE = Noise(np.array([SD**2]), ((1,),), np.log([1e-3]))


def latch(s):
    """x' = load beyond -1 and 1, nothing in between: a wide guess of the load moves both ways and not at all."""
    x, load = s.state("x", "m", 0.01), s.state("load", "m/s", 1.0, spread=SPREAD)
    push = s.input("command", "m/s")
    force = load + push
    s.rate(x, force - ca.fmin(ca.fmax(force, -1), 1))
    s.rate(load, -2 * load * ca.fabs(load))
    s.output("position", "m", x)


def recording(load, push=0.0, seconds=1.0, name="a"):
    """Its path by small steps."""
    x, out = 0.0, []
    for _ in range(round(seconds / DT)):
        out.append(x)
        for _ in range(20):
            force = load + push
            x += DT / 20 * (force - np.clip(force, -1, 1))
            load -= DT / 20 * 2 * load * abs(load)
    measured = np.array(out) + SD * np.random.default_rng(5).standard_normal(len(out))
    channels = {
        "command": Channel("command", "u", "m/s", np.full(len(out), push)),
        "position": Channel("position", "x", "m", measured, sd=SD),
    }
    return Recording(name, DT * np.arange(len(out)), channels)


@pytest.fixture(scope="module")
def axis(tmp_path_factory):
    """The first second of steps of an independent rig of known parameters, posed, with the run itself."""
    base = {"viscous": 70.0, "coulomb": 80.0, "discharge": 0.75, "residual_length": 0.01}
    case = Case("case-1", "nothing", 6, base, (), False, "usual", Sensors(), Controller(), reach=0.1)
    recorded = record(case, 1.0)
    run, x = recorded.runs["steps"], recorded.tables["steps"]["x"].to_numpy() / 1e3
    path = tmp_path_factory.mktemp("axis") / "rig.toml"
    path.write_text(RIG.format(name="axis"))
    channels = {
        "command": Channel("command", "u", "1", run.command / case.controller.limit),
        "position": Channel("position", "x", "m", x, sd=case.sensors.position_noise),
    }
    rig = read_rig(path)
    model = rig.model
    truth = {
        "viscous_friction": 70.0, "coulomb_friction": 80.0, "discharge_coefficient": 0.75, "residual_length": 0.01,
        "presliding_length": 2e-6, "presliding_shape": 1.0, "bristle_damping": 3e-4, "bristle_fading": 0.05,
    }  # fmt: skip
    noise = Noise(np.array([case.sensors.position_noise**2, 1.0, 1.0]), ((1,), (2, 3)), np.log([1e-5, 1e-4]))
    problem = pose(model, [Recording("steps", run.t, channels)], WHOLE)
    return model, problem, model.vector({**rig.parameters, **truth}), noise, run


def test_half_a_second_later_the_pressures_are_nearer_the_truth_and_the_record_is_likelier(axis):
    model, problem, p, noise, run = axis
    whole, start = start_of(model, p[None], 1), first_look(model, problem, p, noise, 0.5)
    off, scores = [], []
    for one in (whole, start):
        Q, R = noise.spectrum(len(model.states))[None], noise.measurement[None]
        f = run_filter(model, problem, p[None], Q, R, keep=True, start=one)
        off.append(np.abs(f.states[0, 500, 2:4] - [run.pressure_a[500], run.pressure_b[500]]).max())
        scores.append(deviance(f.innovations[0], f.variances[0])[:501].sum())
    assert off[1] < 0.5 * off[0]
    assert scores[1] < scores[0] - 100.0


def test_what_is_seen_at_once_keeps_what_the_model_says_of_it(axis):
    model, problem, p, noise, _ = axis
    whole, start = start_of(model, p[None], 1), first_look(model, problem, p, noise, 0.5)
    assert start.mean.shape == start.sd.shape == (1, 1, len(model.states))
    assert start.mean[0, 0, 0] == whole.mean[0, 0, 0]
    assert start.sd[0, 0, 0] == whole.sd[0, 0, 0]
    hidden = start.sd[0, 0, 2:] / whole.sd[0, 0, 2:]
    assert hidden == pytest.approx(1.0) or hidden == pytest.approx(NARROW)
    shown = replace(problem, measured=np.column_stack([problem.measured[:, 0], run_pressures(axis)]))
    seen = first_look(model, shown, p, replace(noise, measurement=np.array([9e-10, 2.5e5, 2.5e5])), 0.5)
    assert np.array_equal(seen.mean[0, 0, 2:4], whole.mean[0, 0, 2:4])


def test_a_record_that_begins_at_rest_is_found_at_rest_and_one_cut_from_a_motion_is_not(axis):
    model, problem, p, noise, run = axis
    still = first_look(model, problem, p, noise, 0.5)
    assert still.mean[0, 0, 1] == 0.0
    assert still.sd[0, 0, 1] < 1e-3
    moving = int(np.argmax(np.abs(run.velocity[:400])))
    rows = slice(moving, None)
    late = replace(
        problem, time=problem.time[rows] - problem.time[moving], dt=problem.dt[rows], inputs=problem.inputs[rows],
        measured=problem.measured[rows], counts=problem.counts - moving,
    )  # fmt: skip
    thrown = first_look(model, late, p, noise, 0.5)
    assert abs(thrown.mean[0, 0, 1] - run.velocity[moving]) < 2.0 * thrown.sd[0, 0, 1]


def run_pressures(axis):
    """Measured without noise."""
    return np.column_stack([axis[4].pressure_a, axis[4].pressure_b])


def test_a_record_that_tells_nothing_begins_as_the_model_says():
    model = build(latch)
    problem = pose(model, [recording(0.0)], WHOLE)
    p = model.vector({})
    start, whole = first_look(model, problem, p, NOISE, 0.05), start_of(model, p[None], 1)
    assert np.array_equal(start.mean, whole.mean)
    assert np.array_equal(start.sd, whole.sd)


def test_only_the_first_moments_count():
    """A push that comes later tells of the load, but not in time."""
    model = build(latch)
    first, later = recording(0.0, seconds=0.3), recording(2.0, push=4.0, seconds=0.7)
    channels = {
        role: Channel(role, role, first[role].unit, np.concatenate([first[role].values, later[role].values]))
        for role in ("command", "position")
    }
    both = Recording("both", DT * np.arange(1000), channels)
    p = model.vector({})
    start = first_look(model, pose(model, [both], WHOLE), p, NOISE, 0.25)
    alone = first_look(model, pose(model, [first], WHOLE), p, NOISE, 0.25)
    assert np.array_equal(start.mean, alone.mean)


def test_every_segment_is_looked_at_by_itself():
    model = build(latch)
    runs = [recording(load, push=push, seconds=0.6) for load, push in ((-3.0, 2.0), (1.5, 0.0), (3.0, 1.0))]
    p = model.vector({})
    both = first_look(model, pose(model, runs, WHOLE), p, NOISE, 0.25)
    alone = [first_look(model, pose(model, [run], WHOLE), p, NOISE, 0.25) for run in runs]
    assert np.array_equal(both.mean[0], [one.mean[0, 0] for one in alone])
    assert np.array_equal(both.sd[0], [one.sd[0, 0] for one in alone])
    assert len(np.unique(both.mean[0], axis=0)) == 3


def test_parts_make_up_the_whole():
    z = np.sqrt(1.0 - NARROW**2) * _spread(3)
    assert z.shape == (PARTS, 3)
    assert np.abs(z.mean(axis=0)).max() < 0.05
    assert np.var(z, axis=0) + NARROW**2 == pytest.approx(1.0, abs=0.05)
