"""An axis that sticks: judged over steps of every size and seeds of noise, and gains that hunt lose."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from optid.armax.files import ArmaxFile, SavedModel
from optid.armax.model import Armax
from optid.armax.sliding import SlidingAxis
from optid.errors import InputError
from optid.pid.controller import Controller, Gains, Settings
from optid.tuning.baselines import Baseline
from optid.tuning.bench_search import EvaluatedCandidates
from optid.tuning.criterion import Criterion
from optid.tuning.integrator import Integrator, with_integrator
from optid.tuning.judges import FITTED
from optid.tuning.loop import ClosedLoop
from optid.tuning.plant import Plant, plant_of
from optid.tuning.problem import build_problem
from optid.tuning.response_metrics import by_size
from optid.tuning.search import box
from optid.tuning.specification import TuningSpec
from optid.tuning.step_tests import StepPlan, hunting_limit, sizes_for
from optid.tuning.sticking_axis import Mechanics, StickingAxis, assumed_mechanics
from optid.tuning.structures import (
    STRUCTURES,
    cascaded,
    drive_values,
    free_gains,
    structure_of,
    usual_structure,
)
from optid.tuning.systems import closed_loop, controller_system
from optid.tuning.task import Task
from optid.tuning.tuning import UNSTABLE, _remarks, score
from optid.tuning.ultimate import ultimate
from tests.tuning.small_axis import T, axis

LIMITS = Settings(T, -5, 5)
PLAN = StepPlan((0.06, -0.015), 400, T, 3e-5, runs=3, variants=2)


def test_steps_of_every_size_both_ways_and_shares_of_the_largest():
    sizes = sizes_for((0.02, -0.08))
    assert sizes[:2] == (0.02, -0.08) and {0.08, -0.02, 0.04, -0.06, -0.01} <= {round(s, 9) for s in sizes}
    assert sizes_for((0.06,), lambda size: size > 0) == (0.06, 0.045, 0.015, 0.0075)


def test_every_run_has_steps_of_a_stronger_plant_and_every_variant_is_one():
    sizes = (0.06, -0.06, 0.03, -0.03, 0.015, -0.015)
    episodes = StepPlan(sizes, 400, T, 3e-5, runs=4, variants=2, stronger=1.5).episodes()
    for run in range(1, 4):
        assert sorted(e.gain for e in episodes if e.run == run) == [1.0] * 4 + [1.5] * 2
    assert {(e.variant, e.gain) for e in episodes if e.run} == {(v, g) for v in range(3) for g in (1.0, 1.5)}
    assert all(e.gain == 1.0 for e in episodes if e.run == 0)


def test_costs_of_steps_count_alike_and_the_first_runs_are_quiet():
    episodes = PLAN.episodes()
    assert len(episodes) == 6
    assert sum(e.weight * abs(e.reference[0]) / 0.06 for e in episodes) == pytest.approx(1.0)
    quiet, noisy = episodes[:2], episodes[2:]
    assert not any(e.noise.any() or e.variant for e in quiet)
    assert {e.variant for e in noisy} == {0, 1, 2}
    for e in noisy:
        assert np.std(e.noise) == pytest.approx(3e-5, rel=0.15)
    np.testing.assert_array_equal(episodes[3].noise, PLAN.episodes()[3].noise)


def test_noise_and_dead_zone_in_the_linear_loop():
    """Sample by sample in plain Python."""
    plant = Plant(plant_of(axis()).a, plant_of(axis()).b, T, dead_zone=(-0.3, 0.2))
    episode = PLAN.episodes()[2]
    closed_loop = ClosedLoop((plant,), (episode,), Criterion(), LIMITS.vector, 10.0)
    gains = Gains(30.0, 10.0, 0.2, 2e-3)
    y, u = closed_loop.trace(gains.vector)
    controller, past = Controller(gains, LIMITS), np.zeros((2, 400 + 4))
    for n in range(400):
        seen = past[0, n + 3] = float(
            -plant.a @ past[0, n + 2 :: -1][:3] + plant.b @ past[1, n + 2 :: -1][:3]
        )
        assert y[n] == pytest.approx(seen, abs=1e-12)
        command = controller.step(float(episode.reference[n]), seen + float(episode.noise[n]))
        assert u[n] == pytest.approx(command, abs=1e-9)
        past[1, n + 3] = command - min(max(command, -0.3), 0.2)
    cost, hunting = closed_loop.judged(gains.vector)
    assert cost[0, 0] == pytest.approx(
        episode.weight * T * T * np.sum(np.arange(400) * np.abs(episode.reference - y)), rel=1e-9
    )
    assert hunting[0, 0] == pytest.approx(np.ptp(y[200:]), rel=1e-12)


def test_without_friction_the_axis_is_the_model():
    """Its mechanics are the model's poles and gain, and with no share of dry friction it answers alike."""
    plant = plant_of(axis())
    found = assumed_mechanics(plant, 5.0)
    viscous = [one.viscous / (1.0 - share) for one, share in zip(found, (0.5, 0.25, 0.75), strict=True)]
    assert (found[0].gain, found[0].frequency) == pytest.approx((0.55 * 60.0**2, 60.0), rel=3e-3)
    assert viscous == pytest.approx([48.0] * 3, rel=1e-3)
    [episode] = StepPlan((0.06,), 400, T).episodes()
    bench = StickingAxis([replace(found[0], viscous=48.0, dry=0.0)], (episode,))
    gains = Gains(12.0, 0.0, 0.05, 2e-3)
    [run] = bench(gains, LIMITS)
    y, _ = ClosedLoop((plant,), (episode,), Criterion(), LIMITS.vector, 10.0).trace(gains.vector)
    assert np.abs(run.output - y).max() < 0.02 * 0.06


def test_what_friction_holds_does_not_move():
    found = assumed_mechanics(plant_of(axis()), 5.0)[0]
    dry = found.dry
    assert found.viscous == pytest.approx(24.0, rel=1e-3) and dry == pytest.approx(
        24.0 * 0.55 * 2.5 * math.pi / 4, rel=1e-3
    )
    [episode] = StepPlan((1.0,), 50, T).episodes()
    # The force of a standing command grows at k u: it breaks away after dry / (k u).
    after = 20
    held = Gains(dry / (0.55 * 60.0**2 * after * T))
    [run] = StickingAxis([found], (episode,))(held, Settings(T))
    first = int(np.flatnonzero(run.output)[0])
    assert first == pytest.approx(after, abs=2)
    # With more friction at rest it breaks away later, and once it slides it goes further.
    [late] = StickingAxis([replace(found, breakaway=1.5, creep=0.02)], (episode,))(held, Settings(T))
    assert int(np.flatnonzero(late.output)[0]) == pytest.approx(1.5 * after, abs=2)
    # Behind a dead zone the command is smaller.
    [less] = StickingAxis([found], (episode,), (-0.2 * held.kp, 0.2 * held.kp))(held, Settings(T))
    assert int(np.flatnonzero(less.output)[0]) == pytest.approx(after / 0.8, abs=2)


def test_the_force_decays_and_the_air_is_stiffer_off_the_middle():
    """At full command, against the equations in finer steps; beyond its reach the parabola stays as it is."""
    axis, reach, h = Mechanics(2000.0, 60.0, 30.0, 20.0, decay=6.0), 0.05, 1e-5
    varied = replace(axis, position_dependence=(-2.0, 90.0, 3.0, 70.0, reach))
    [episode] = StepPlan((10.0,), 250, T).episodes()
    [run] = StickingAxis([varied], (episode,))(Gains(1e3), Settings(T, low=-2.0, high=2.0))
    x = v = force = 0.0
    for n in range(250):
        assert run.output[n] == pytest.approx(x, rel=0.02, abs=1e-3)
        for _ in range(round(T / h)):
            at = min(x, reach)
            gain, spring = 1.0 - 2.0 * at + 90.0 * at * at, 1.0 + 3.0 * at + 70.0 * at * at
            force += h * (2000.0 * gain * 2.0 - 3600.0 * spring * v - 6.0 * 2.0 * force)
            v = max(v + h * (force - 30.0 * v - 20.0), 0.0)
            x += h * v
    assert x > 2.0 * reach


@pytest.mark.parametrize("gain", [0.55, -0.55])
def test_hunting_multiplies_the_cost(gain):
    """Integral action makes an axis that sticks hunt, though the linear model likes it."""
    plant = plant_of(axis(gain=gain))
    plan = StepPlan((0.06, -0.015), 1000, T, 3e-5, runs=2)
    episodes, sign = plan.episodes(), math.copysign(1.0, gain)
    rest, hunt = (sign * np.array([20.0, ki, 0.1, 0, 0, 0]) + [0, 0, 0, 2e-3, 1, 0] for ki in (0.0, 600.0))
    assert Task((plant,), episodes, LIMITS).missed(hunt[None])[0] == 0.0
    bench = StickingAxis(assumed_mechanics(plant, 5.0), episodes)
    task = Task((plant,), episodes, LIMITS, bench=bench, bench_alone=True, hunting=hunting_limit(0.06, 3e-5))
    costs = task.fitness(np.array([rest, hunt]))
    bare = replace(task, hunting=math.inf).fitness(np.array([rest, hunt]))
    assert costs[0] == pytest.approx(bare[0], rel=1e-12)
    assert costs[0] < costs[1]
    runs = bench(Gains(*hunt), LIMITS)
    times = [max(run.hunting / (0.5 * task.hunting), 1.0) ** 2 for run in runs]
    counted = [run.episode.weight * run.measures["itae"] * t for run, t in zip(runs, times, strict=True)]
    assert max(row.hunting for row in by_size(runs)) > task.hunting
    assert costs[1] == pytest.approx(sum(counted))
    assert len(set(times)) == len(times)  # each episode for itself


def test_assumed_friction_does_not_judge_integral_action():
    assert usual_structure(simulated=True, known=False) == "pd"
    assert free_gains(STRUCTURES["pid"], True) == ("kp", "ki", "kd", "derivative_filter")
    assert free_gains(STRUCTURES["p-pi"], True, True) == ("kp", "ki", "kd", "derivative_weight")
    assert usual_structure(simulated=True, known=True) == "pid"
    assert usual_structure(simulated=False, known=False) == "pid2"


def test_a_loop_that_only_friction_and_limits_hold_is_told():
    plant, episodes = plant_of(axis()), PLAN.episodes()
    task = Task(
        (plant,),
        episodes,
        LIMITS,
        bench=StickingAxis(assumed_mechanics(plant, 5.0), episodes),
        bench_alone=True,
    )
    wild, calm = (score(task, Baseline("tuned", Gains(kp, 0.0, 0.1, 2e-3), "")) for kp in (2000.0, 5.0))
    assert task.missed(wild.gains.vector)[0] == 0.0 and not wild.stable
    assert UNSTABLE in _remarks(task, wild) and UNSTABLE not in _remarks(task, calm)


def test_candidates_that_are_beaten_are_not_run_to_the_end():
    plant, episodes = plant_of(axis()), PLAN.episodes()
    bench = StickingAxis(assumed_mechanics(plant, 5.0), episodes)
    gains = np.array([Gains(20.0, 0.0, 0.1, 2e-3).vector])
    whole, _ = bench.judged(gains, LIMITS, Criterion(), 10.0)
    part, _ = bench.judged(gains, LIMITS, Criterion(), 10.0, bar=whole / 2)
    assert whole[0] / 2 < part[0] < whole[0]
    assert bench.only([1, 4])(Gains(20.0), LIMITS)[1].episode is episodes[4]


@pytest.mark.parametrize(
    ("pole", "sd", "choice", "exact"),
    [
        (1.0002, 0.0, Integrator.AUTO, True),
        (1.0002, 0.0, Integrator.NO, False),
        (0.9996, 0.0, Integrator.AUTO, False),
        (0.9996, 2e-4, Integrator.AUTO, True),
        (0.9996, 0.0, Integrator.YES, True),
        (0.99, 0.0, Integrator.YES, False),
    ],
)
def test_an_integrator_is_carried_exactly(pole, sd, choice, exact):
    a = np.poly([pole, 0.9])
    covariance = None
    if sd:
        # Of the pole alone: d a / d pole = (-1, 0.9).
        J = np.array([-1.0, 0.9, 0.0])
        covariance = tuple(map(tuple, sd**2 * np.outer(J, J)))
    model = Armax(tuple(a), ((1e-3,),), nk=(1,), sample_time=T, covariance=covariance)
    plant, said = with_integrator(plant_of(model), model, choice)
    slow = max(plant.poles.real)
    assert bool(said) is exact
    assert slow == pytest.approx(1.0 if exact else pole, abs=1e-12)
    assert sorted(plant.poles.real)[0] == pytest.approx(0.9, abs=1e-9)
    assert not (exact and any("drifts" in remark for remark in plant.remarks))


def test_a_cascade_is_the_controller_with_a_set_point_weight():
    """P position over PI velocity, written out, gives the commands of the PID that its gains become."""
    Kv, Kp, Tn, lag = 12.0, 2.5, 0.08, 2e-3
    row = np.array([[Kp * Kv, Kp * Kv / Tn, Kp, lag, 1.0, 0.0]])
    controller = Controller(Gains(*cascaded(row)[0]), Settings(T))
    controller.reset(0.0, 0.0)
    rng = np.random.default_rng(0)
    r, y = 0.05, np.cumsum(rng.normal(0, 1e-4, 200)) - 1e-4
    integral, slope, before = 0.0, 0.0, 0.0
    for n in range(200):
        slope = (lag * slope + y[n] - before) / (lag + T)
        before = y[n]
        # The integral of the speed is the way.
        integral += T * Kv * (r - y[n])
        command = Kp * (Kv * (r - y[n]) - slope) + Kp / Tn * (integral - y[n])
        assert controller.step(r, float(y[n])) == pytest.approx(command, rel=1e-9, abs=1e-12)
    values = {
        name: value for name, value, _ in drive_values(controller.gains, STRUCTURES["p-pi"], 5.0, ("V", "m"))
    }
    assert (values["Kv"], values["Tn"]) == pytest.approx((Kv, 80.0))
    with pytest.raises(InputError, match="p-pi"):
        structure_of("p-pj")


def test_a_box_of_cascades_goes_there_and_back():
    scale = ultimate(plant_of(axis()))
    within = box(("kp", "ki", "kd"), Gains(1.0, derivative_filter=2e-3), scale)
    within = type(within)(**{**vars(within), "cascade": True})
    points = np.random.default_rng(0).uniform(0.1, 1.0, (20, 3))
    gains = within.gains(points)
    assert np.all(gains[:, 4] < 1.0)
    np.testing.assert_allclose(within.points(gains), points, atol=1e-9)


def test_python_control_sees_the_same_loop():
    import control

    plant, gains = plant_of(axis()), Gains(20.0, 40.0, 0.2, 2e-3, 0.7, 0.3)
    [episode] = StepPlan((0.06,), 300, T).episodes()
    y, u = ClosedLoop((plant,), (episode,), Criterion(), Settings(T).vector, 1.0).trace(gains.vector)
    time = T * np.arange(300)
    answer = control.forced_response(closed_loop(plant, gains), time, episode.reference)
    np.testing.assert_allclose(np.ravel(answer.outputs), y, atol=1e-9)
    alone = control.forced_response(controller_system(gains, T), time, np.array([episode.reference, y]))
    np.testing.assert_allclose(np.ravel(alone.outputs), u, atol=1e-6)


def test_what_a_fit_knows_of_its_parameters(tmp_path):
    from optid.rigs.rigfile import read_rig
    from optid.tuning.known import fitted, parameter_sets, sensor_noise
    from tests.tuning.test_tune_bench import DATA

    path = tmp_path / "rig.toml"
    path.write_text((DATA / "bench.toml").read_text())
    rig = read_rig(path)
    rough = parameter_sets(rig, np.random.default_rng(0))
    assert not fitted(rig) and set(rough[0]) == {freed.name for freed in rig.freed}
    document = {
        "schema": "optid.fit/1",
        "noise": {"position": {"sd": 4e-5}},
        "parameters": {
            "coulomb_friction": {"value": 83.0, "unit": "N", "ci95": [83.0 - 1.96, None]},
            "viscous_friction": {"value": 50.0, "unit": "N s/m", "ci95": [40.0, 60.0]},
        },
    }
    (tmp_path / "fit.json").write_text(json.dumps(document))
    draws = parameter_sets(rig, np.random.default_rng(0), 400)
    # The other one is of another fit: the rig file holds 78.
    assert fitted(rig) and set(draws[0]) == {"coulomb_friction"}
    assert np.std([one["coulomb_friction"] for one in draws]) == pytest.approx(1.0, rel=0.15)
    assert sensor_noise(rig, "position") == 4e-5
    (tmp_path / "fit.json").unlink()
    floor = {"schema": "optid.diagnosis/1", "noise_floor": {"position": {"rmse": 3e-5, "unit": "m"}}}
    (tmp_path / "diagnosis.json").write_text(json.dumps(floor))
    assert sensor_noise(rig, "position") == 3e-5


@pytest.mark.parametrize("size", [1e-25, 1e25])
def test_a_model_whose_gains_leave_the_floats_is_refused(size):
    model = Armax(a=(1.0, -0.9), b=((size,),), c=(1.0, 0.1), nk=(1,), sample_time=T, noise_variance=0.0)
    with pytest.raises(InputError, match="b: coefficients of 1e"):
        plant_of(model)


SHOWN = SlidingAxis(0.55, 0.1, 60.0, 30.0, 20.0, 1.5, -0.04, 0.1, 0.9)


def test_the_axis_that_a_recording_shows_judges():
    """Its friction, break-away, load and dead zone; integral action is free, since what it does at rest is known."""
    model = axis()
    contents = ArmaxFile("command", "position", 3, (SavedModel(model),), axis=SHOWN)
    problem = build_problem(contents, Path("armax.json"), TuningSpec(), np.random.default_rng(0))
    judge, said = problem.task.bench, " ".join(problem.assumed)
    assert problem.judged_on == FITTED and problem.structure == "pid"
    # What the regression mistakes is put right; half of the asymmetry is the valve's, none and all in the other sets.
    first = judge.axes[0]
    assert (first.viscous, first.dry, first.breakaway) == pytest.approx((28.5, 25.0, 1.5))
    assert (
        first.gain == pytest.approx(1.15 * 0.55 * 60.0**2)
        and first.position_dependence == SHOWN.position_dependence
    )
    assert [one.asymmetry for one in judge.axes] == pytest.approx([0.05, 0.0, 0.1, 0.1, 0.0])
    assert {e.load[0] for e in judge.episodes} == {-0.04} and all(e.noise.any() for e in judge.episodes)
    assert {e.variant for e in judge.episodes} == set(range(5)) and max(e.gain for e in judge.episodes) > 1.0
    assert tuple(judge._dead) == (-0.1, 0.1)
    assert "50 % more at rest" in said and "dead zone of ±0.1 V" in said and "load of -0.04 V" in said
    own = build_problem(
        contents, Path("armax.json"), TuningSpec(dead_zone=(-0.2, 0.3)), np.random.default_rng(0)
    )
    assert tuple(own.task.bench._dead) == (-0.2, 0.3)
    plain = build_problem(
        replace(contents, axis=None), Path("a.json"), TuningSpec(), np.random.default_rng(0)
    )
    assert plain.structure == "pd" and plain.task.bench.axes[0].breakaway == 1.0


def test_luck_is_not_shared_among_neighbours():
    """A lone point with a low cost does not go on before a valley; what was seen in more runs counts more."""
    valley = 0.5 + 0.01 * np.random.default_rng(0).standard_normal((20, 2))
    points = np.vstack([valley, [[0.52, 0.52]], 0.1 + 0.01 * np.random.default_rng(1).random((20, 2))])
    costs = np.r_[np.full(20, 1.0), 5.0, np.full(19, 3.0), 0.9]
    seen = EvaluatedCandidates(points, costs, np.ones(41))
    best = seen.best(points, 10)
    assert np.all(np.linalg.norm(best - 0.5, axis=1) < 0.1)
    more = seen.and_also(points[-1:], np.array([0.5]), 200)
    assert np.linalg.norm(more.best(points, 1)[0] - points[-1]) < 0.02
    assert np.isfinite(
        EvaluatedCandidates(points, np.r_[costs[:-1], np.inf], np.ones(41)).best(points, 3)
    ).all()
