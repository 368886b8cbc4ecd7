"""A first look: where a record begins, of what no sensor sees, on plants whose start is known."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy import stats

from optid.core.recording import Channel, Recording
from optid.core.sheet import build
from optid.estimation.initial_gaussian_sum import NARROW, PARTS, Known, _spread, first_look
from optid.estimation.likelihood import WHOLE, Noise, deviance, run_filter, start_of
from optid.estimation.problem import build_problem
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
    pushes = np.broadcast_to(push, round(seconds / DT))
    for push in pushes:
        out.append(x)
        for _ in range(20):
            force = load + push
            x += DT / 20 * (force - np.clip(force, -1, 1))
            load -= DT / 20 * 2 * load * abs(load)
    measured = np.array(out) + SD * np.random.default_rng(5).standard_normal(len(out))
    channels = {
        "command": Channel("command", "u", "m/s", pushes),
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
        "viscous_friction": 70.0,
        "coulomb_friction": 80.0,
        "discharge_coefficient": 0.75,
        "residual_length": 0.01,
        "presliding_length": 2e-6,
        "presliding_shape": 1.0,
        "bristle_damping": 3e-4,
        "bristle_fading": 0.05,
    }
    noise = Noise(np.array([case.sensors.position_noise**2, 1.0, 1.0]), ((1,), (2, 3)), np.log([1e-5, 1e-4]))
    steps = [Recording("steps", run.t, channels)]
    problem, cut = build_problem(model, steps, WHOLE), build_problem(model, steps, 0.5)
    return model, problem, cut, model.vector({**rig.parameters, **truth}), noise, run


def filtered(model, known, p, noise):
    Q, R = noise.spectrum(len(model.states))[None], noise.measurement[None]
    return run_filter(model, known.pieces, p[None], Q, R, keep=True, start=known.start)


def sd_of(start):
    return np.sqrt(np.diagonal(start.covariance, axis1=-2, axis2=-1))


def test_half_a_second_later_the_pressures_are_where_they_are_and_the_record_is_likelier(axis):
    model, problem, cut, p, noise, run = axis
    off, scores = [], []
    for known in (Known(problem, start_of(model, p[None], 1)), first_look(model, problem, cut, p, noise)):
        f, end = filtered(model, known, p, noise), cut.begins[1]
        off.append(np.abs(f.states[0, end, 2:4] - [run.pressure_a[end], run.pressure_b[end]]).max())
        scores.append(deviance(f.innovations[0], f.variances[0])[:end].sum())
    assert off[1] < 0.5 * off[0]
    assert scores[1] < scores[0] - 100.0


def test_where_a_window_ends_the_truth_is_as_far_off_as_the_covariance_says(axis):
    model, problem, cut, p, noise, run = axis
    known, end = first_look(model, problem, cut, p, noise), cut.begins[1]
    assert known.pieces.begins.tolist() == [0, end]
    truth = [run.position[end], run.velocity[end], run.pressure_a[end], run.pressure_b[end]]
    off = known.start.mean[0, 1, :4] - truth
    assert off @ np.linalg.solve(known.start.covariance[0, 1, :4, :4], off) < stats.chi2.ppf(0.999, 4)


def test_what_is_seen_at_once_keeps_what_the_model_says_of_it(axis):
    model, problem, cut, p, noise, _ = axis
    whole, start = start_of(model, p[None], 1), first_look(model, problem, cut, p, noise).start
    assert start.mean[0, 0, 0] == whole.mean[0, 0, 0]
    assert sd_of(start)[0, 0, 0] == sd_of(whole)[0, 0, 0]
    hidden = sd_of(start)[0, 0, 2:] / sd_of(whole)[0, 0, 2:]
    assert hidden == pytest.approx(1.0) or hidden == pytest.approx(NARROW)
    shown = replace(problem, measured=np.column_stack([problem.measured[:, 0], run_pressures(axis)]))
    seen = first_look(model, shown, cut, p, replace(noise, measurement=np.array([9e-10, 2.5e5, 2.5e5]))).start
    assert np.array_equal(seen.mean[0, 0, 2:4], whole.mean[0, 0, 2:4])


def test_a_record_that_begins_at_rest_is_found_at_rest_and_one_cut_from_a_motion_is_not(axis):
    model, problem, cut, p, noise, run = axis
    still = first_look(model, problem, cut, p, noise).start
    assert still.mean[0, 0, 1] == 0.0
    assert sd_of(still)[0, 0, 1] < 1e-3
    moving = int(np.argmax(np.abs(run.velocity[:400])))
    rows = slice(moving, None)
    late = replace(
        problem,
        time=problem.time[rows] - problem.time[moving],
        dt=problem.dt[rows],
        inputs=problem.inputs[rows],
        measured=problem.measured[rows],
        counts=problem.counts - moving,
    )
    thrown = first_look(model, late, replace(cut, begins=cut.begins - np.array([0, moving])), p, noise).start
    assert abs(thrown.mean[0, 0, 1] - run.velocity[moving]) < 2.0 * sd_of(thrown)[0, 0, 1]


def run_pressures(axis):
    """Measured without noise."""
    return np.column_stack([axis[-1].pressure_a, axis[-1].pressure_b])


def looked_at(model, recordings, p, seconds):
    whole, cut = (build_problem(model, recordings, span) for span in (WHOLE, seconds))
    return first_look(model, whole, cut, p, NOISE)


def test_a_record_that_tells_nothing_begins_as_the_model_says():
    model = build(latch)
    p = model.vector({})
    known, whole = looked_at(model, [recording(0.0)], p, 0.05), start_of(model, p[None], 1)
    assert len(known.pieces.begins) == 1  # loads that would have moved it are out of the question
    assert np.array_equal(known.start.mean, whole.mean)
    assert np.array_equal(known.start.covariance, whole.covariance)


def test_only_the_first_moments_say_where_the_record_begins():
    """A push that comes later tells of the load, but not in time."""
    model = build(latch)
    first, later = recording(0.0, seconds=0.3), recording(2.0, push=4.0, seconds=0.7)
    channels = {
        role: Channel(role, role, first[role].unit, np.concatenate([first[role].values, later[role].values]))
        for role in ("command", "position")
    }
    both = Recording("both", DT * np.arange(1000), channels)
    p = model.vector({})
    known, alone = looked_at(model, [both], p, 0.25), looked_at(model, [first], p, 0.25)
    assert np.array_equal(known.start.mean[:, 0], alone.start.mean[:, 0])


def test_a_later_window_tells_what_the_first_one_did_not():
    """At rest nothing shows of the load; after a push it is known, and the filter begins anew with that."""
    model = build(latch)
    pushed = np.where(np.arange(1000) < 500, 0.0, 3.0)
    run = recording(0.5, push=pushed)
    p = model.vector({})
    known = looked_at(model, [run], p, 0.25)
    assert known.pieces.begins[1] == pytest.approx(750, abs=2)
    load, row = 0.5, known.pieces.begins[1]
    for _ in range(row * 20):
        load -= DT / 20 * 2 * load * abs(load)
    assert abs(known.start.mean[0, 1, 1] - load) < 3.0 * sd_of(known.start)[0, 1, 1]
    assert sd_of(known.start)[0, 1, 1] < 0.02 * SPREAD


def test_what_is_read_where_a_window_ends_is_not_yet_known():
    model, p = build(latch), build(latch).vector({})
    run = recording(-3.0, push=2.0, seconds=1.0)
    problem, cut = build_problem(model, [run], WHOLE), build_problem(model, [run], 0.25)
    known = first_look(model, problem, cut, p, NOISE)
    end = known.pieces.begins[1]
    problem.measured[end] += 1.0
    assert np.array_equal(first_look(model, problem, cut, p, NOISE).start.mean[0, 1], known.start.mean[0, 1])


def test_where_only_a_speed_is_hidden_a_record_is_looked_at_moving_and_at_rest():
    """At rest nothing is left for least squares to move."""

    def sliding(s):
        x, v = s.state("x", "m", 0.01), s.state("v", "m/s", 1.0, spread=SPREAD)
        s.rate(x, v)
        s.rate(v, s.input("command", "m/s2"))
        s.output("position", "m", x)

    model, t = build(sliding), DT * np.arange(1000)
    noise = SD * np.random.default_rng(5).standard_normal(len(t))
    for speed in (0.0, 0.3):
        channels = {
            "command": Channel("command", "u", "m/s2", np.zeros(len(t))),
            "position": Channel("position", "x", "m", speed * t + noise, sd=SD),
        }
        known = looked_at(model, [Recording("a", t, channels)], model.vector({}), 0.25)
        assert abs(known.start.mean[0, 1, 1] - speed) < 4.0 * sd_of(known.start)[0, 1, 1] < 1e-2


def test_every_segment_is_looked_at_by_itself():
    model = build(latch)
    runs = [recording(load, push=push, seconds=0.6) for load, push in ((-3.0, 2.0), (1.5, 0.0), (3.0, 1.0))]
    p = model.vector({})
    both, alone = looked_at(model, runs, p, 0.25), [looked_at(model, [run], p, 0.25) for run in runs]
    heads = np.searchsorted(both.pieces.begins, np.cumsum([0, 600, 600]))
    assert np.array_equal(both.start.mean[0], np.concatenate([one.start.mean[0] for one in alone]))
    assert np.array_equal(
        both.start.covariance[0], np.concatenate([one.start.covariance[0] for one in alone])
    )
    assert len(np.unique(both.start.mean[0, heads], axis=0)) == 3
    assert [both.pieces.recording[k] for k in heads] == [0, 1, 2]


def test_pieces_hold_every_sample_once(axis):
    model, problem, cut, p, noise, _ = axis
    pieces = first_look(model, problem, cut, p, noise).pieces
    rows = np.concatenate(
        [np.arange(a, a + n + 1) for a, n in zip(pieces.begins, pieces.counts, strict=True)]
    )
    assert rows.tolist() == list(range(len(problem.time)))


def test_no_more_windows_are_looked_at_than_may_be(monkeypatch):
    monkeypatch.setattr("optid.estimation.initial_gaussian_sum.LOOKS", 2)
    model = build(latch)
    run = recording(0.5, push=np.where(np.arange(1000) < 500, 0.0, 3.0))
    assert len(looked_at(model, [run], model.vector({}), 0.25).pieces.begins) == 1


def test_only_the_longest_segments_are_begun_anew(monkeypatch):
    model, p = build(latch), build(latch).vector({})
    runs = [recording(-3.0, push=2.0, seconds=seconds, name=str(seconds)) for seconds in (0.6, 1.2, 1.2)]
    all_of_them = looked_at(model, runs, p, 0.25).pieces
    assert (np.bincount(all_of_them.recording)[1:] > 1).all()
    monkeypatch.setattr("optid.estimation.initial_gaussian_sum.LONGEST", 1)
    few = looked_at(model, runs, p, 0.25).pieces
    assert few.recording.tolist() == [0, 1, 1, 2]


def test_parts_make_up_the_whole():
    z = np.sqrt(1.0 - NARROW**2) * _spread(3)
    assert z.shape == (PARTS, 3)
    assert np.abs(z.mean(axis=0)).max() < 0.05
    assert np.var(z, axis=0) + NARROW**2 == pytest.approx(1.0, abs=0.05)
