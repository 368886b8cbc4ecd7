"""The tuning as a whole: global, better than the others, within what is required, and honest about the rest."""

import math
from dataclasses import replace

import numpy as np
import pytest

from optid.armax.model import Armax
from optid.errors import InputError, SolveError
from optid.pid.controller import Gains, Settings
from optid.tuning.criterion import Criterion
from optid.tuning.integral_criteria import Measure
from optid.tuning.margins import Required
from optid.tuning.optimise import Options, default_gains, optimise
from optid.tuning.plant import plant_of, scenarios
from optid.tuning.reaction_curve import reaction
from optid.tuning.scenarios import load, step
from optid.tuning.search import box
from optid.tuning.task import Aggregation, Task
from optid.tuning.tuning import tune
from optid.tuning.ultimate import ultimate
from tests.tuning.small_axis import T, axis, python_control

THREE = Options(free=("kp", "ki", "kd"), starts=2)


@pytest.fixture(scope="module")
def tuned(task):
    return tune(task, np.random.default_rng(0), THREE)


def test_no_exhaustive_grid_is_better(task, tuned):
    """Within 0.5 % of the best of 40^3 points over the box, and of 21^3 around the optimum found."""
    within = tuned.within
    around = within.points(tuned.gains.vector)[0]
    for axes in (
        [np.linspace(0, 1, 40)] * 3,
        [np.clip(np.linspace(x - 0.04, x + 0.04, 21), 0, 1) for x in around],
    ):
        points = np.stack([a.ravel() for a in np.meshgrid(*axes, indexing="ij")], axis=1)
        assert tuned.found.cost <= 1.005 * task.fitness(within.gains(points)).min()
    assert tuned.certificate.ratio <= 1.005


def test_the_start_does_not_matter(task, tuned):
    for seed in (1, 2):
        gains = optimise(task, THREE, np.random.default_rng(seed)).gains
        assert task.fitness(gains.vector)[0] == pytest.approx(tuned.found.cost, rel=5e-3)


def test_lower_than_every_baseline(tuned):
    assert {one.name for one in tuned.baselines} == {
        "ziegler_nichols",
        "ziegler_nichols_ultimate",
        "cohen_coon",
        "amigo",
        "simc",
        "python_control",
        "nelder_mead",
        "paper",
        "paper_per_cm",
    }
    for one in tuned.baselines:
        assert tuned.found.total("itae") <= one.total("itae") * (1 + 1e-9), one.name
    by_name = {one.name: one for one in tuned.baselines}
    assert not by_name["paper_per_cm"].stable  # 1600 V/m swings from limit to limit
    assert tuned.found.stable


def test_the_open_loop_is_a_control_object(tuned, model):
    import control

    L = tuned.open_loop
    assert isinstance(L, control.TransferFunction) and L.dt == T
    at = np.exp(1j * np.geomspace(1e-2, 3.0, 50))
    np.testing.assert_allclose(L(at), python_control(model, tuned.gains)(at), rtol=1e-6)


def test_knowing_the_limits_pays(tuned):
    assert tuned.unaware is not None
    assert tuned.aware.total("itae") < tuned.unaware.total("itae")
    for run in tuned.found.responses:
        assert run.command.max() <= 1.0 and run.command.min() >= -1.0


def test_required_sensitivity_is_kept_by_python_control(task, model):
    asked = replace(task, required=Required(maximum_sensitivity=1.4))
    gains = optimise(asked, THREE, np.random.default_rng(0)).gains
    L = python_control(model, gains)
    grid = np.geomspace(1e-2, np.pi / T, 100_000)
    Ms = np.max(1 / np.abs(1 + L(np.exp(1j * grid * T))))
    assert Ms <= 1.4
    assert Ms > 1.38  # the requirement costs something: the optimum lies on it


@pytest.mark.parametrize(
    "required", [Required(gain_margin=4.0), Required(phase_margin=70.0), Required(delay_margin=0.03)], ids=str
)
def test_other_margins_are_kept(task, required):
    from optid.tuning.margins import margins

    gains = optimise(replace(task, required=required), Options(starts=1), np.random.default_rng(0)).gains
    assert required.kept(margins(task.plant, gains.vector))


def test_what_cannot_be_kept_is_said(task):
    with pytest.raises(SolveError, match="no gains keep"):
        optimise(replace(task, required=Required(1.0001, gain_margin=1e6)), THREE, np.random.default_rng(0))


def test_weights_do_what_they_say(task, tuned):
    calm = replace(task, criterion=Criterion(overshoot=20.0, effort=2.0))
    other = tune(calm, np.random.default_rng(0), THREE)
    one, two = tuned.found.responses[0], other.found.responses[0]
    assert two.overshoot <= one.overshoot
    assert two.travel < one.travel
    assert two.measures["itae"] > one.measures["itae"]


def test_a_cost_of_ones_own(task):
    """Written by hand, ITAE leads where the built-in ITAE does."""
    own = replace(
        task, criterion=Criterion(own=lambda time, error, command: float(T * np.sum(time * np.abs(error))))
    )
    vector = Gains(40.0, 60.0, 0.6, 4e-3).vector
    assert own.fitness(vector)[0] == pytest.approx(task.fitness(vector)[0], rel=1e-12)
    gains = optimise(own, Options(free=("kp", "kd"), starts=1), np.random.default_rng(0)).gains
    built_in = optimise(task, Options(free=("kp", "kd"), starts=1), np.random.default_rng(0)).gains
    assert task.fitness(gains.vector)[0] == pytest.approx(task.fitness(built_in.vector)[0], rel=1e-2)


@pytest.mark.parametrize("measure", Measure)
def test_each_measure_is_best_by_itself(task, measure):
    """Gains tuned for a measure beat those tuned for ITAE by that measure, or are the same."""
    gains = optimise(replace(task, criterion=Criterion(measure)), THREE, np.random.default_rng(0)).gains
    for_itae = optimise(task, THREE, np.random.default_rng(0)).gains
    cost = replace(task, criterion=Criterion(measure)).fitness
    assert cost(gains.vector)[0] <= cost(for_itae.vector)[0] * (1 + 1e-6)


def test_robust_over_the_covariance():
    model, rng = axis(spread=0.1), np.random.default_rng(5)
    plants = scenarios(model, 8, rng)
    assert np.std([plant.b.sum() for plant in plants]) > 0
    nominal = Task(plants[:1], (step(0.06, 500, T),), Settings(T, -5, 5))
    for over in Aggregation:
        robust = replace(nominal, plants=plants, over=over)
        for_all = optimise(robust, THREE, np.random.default_rng(0)).gains
        for_one = optimise(nominal, THREE, np.random.default_rng(0)).gains
        assert robust.fitness(for_all.vector)[0] <= robust.fitness(for_one.vector)[0]
        assert nominal.fitness(for_all.vector)[0] >= nominal.fitness(for_one.vector)[0] * (1 - 5e-3)


def test_scenarios_follow_the_covariance():
    model = axis(spread=0.1)
    plants = scenarios(model, 4000, np.random.default_rng(0))
    drawn = np.array([plant.b for plant in plants[1:]])
    np.testing.assert_allclose(drawn.std(axis=0), 0.1 * np.abs(model.b[0]), rtol=0.05)
    with pytest.raises(InputError, match="covariance"):
        scenarios(axis(), 3, np.random.default_rng(0))


def test_a_load_asks_for_integral_action(task):
    both = replace(task, episodes=(step(0.06, 500, T), load(1.0, 500, T)))
    gains = optimise(both, THREE, np.random.default_rng(0)).gains
    alone = optimise(task, THREE, np.random.default_rng(0)).gains
    assert both.fitness(gains.vector)[0] < both.fitness(alone.vector)[0]
    assert gains.ki > 0


def test_negative_gain_needs_negative_gains():
    model = axis(gain=-0.55)
    task = Task((plant_of(model),), (step(0.06, 500, T),), Settings(T, -5, 5))
    gains = optimise(task, THREE, np.random.default_rng(0)).gains
    assert gains.kp < 0 and gains.kd <= 0


def test_difficult_plants_are_named():
    unstable = plant_of(Armax((1.0, -1.05), ((0.1,),), nk=(1,), sample_time=T))
    assert any("unstable" in remark for remark in unstable.remarks)
    drifting = plant_of(Armax((1.0, -1.0004), ((0.1,),), nk=(1,), sample_time=T))
    assert any("drifts" in remark for remark in drifting.remarks)
    backwards = plant_of(Armax((1.0, -0.9), ((-0.1, 0.102),), nk=(1,), sample_time=T))
    assert any("non-minimum-phase" in remark for remark in backwards.remarks)
    sampled = plant_of(axis())  # its zeros outside the circle come from sampling and limit nothing
    assert not sampled.remarks
    at_once = plant_of(Armax((1.0, -0.9), ((0.1,),), nk=(0,), sample_time=T))
    assert "nk = 0" in at_once.remarks[0] and at_once.delay == 1
    for b in ((0.0,), (0.3, -0.3)):
        with pytest.raises(InputError, match="zero static gain"):
            plant_of(Armax((1.0, -0.9), (b,), nk=(1,), sample_time=T))


def test_an_unstable_plant_is_tuned_all_the_same():
    model = Armax((1.0, -1.05), ((0.1,),), nk=(1,), sample_time=T)
    task = Task((plant_of(model),), (step(0.06, 300, T),), Settings(T, -5, 5))
    result = tune(task, np.random.default_rng(0), THREE)
    assert result.found.stable and result.found.margins.gain_reduction > 0
    assert any("unstable" in remark for remark in result.remarks)


def test_reaction_curves_of_known_plants():
    """A first-order lag with delay, and the axis: an integrator behind two lags."""
    lag = Armax((1.0, -math.exp(-T / 0.1)), ((2.0 * (1 - math.exp(-T / 0.1)),),), nk=(11,), sample_time=T)
    plant = plant_of(lag)
    found = reaction(plant, ultimate(plant))
    assert found.gain == pytest.approx(2.0, rel=1e-3)
    assert found.lag == pytest.approx(0.1, rel=0.03)
    assert found.delay == pytest.approx(0.02, rel=0.15)
    plant = plant_of(axis())
    found = reaction(plant, ultimate(plant))
    assert found.integrating
    assert found.gain == pytest.approx(0.55, rel=1e-3)
    assert found.delay == pytest.approx(2 * 0.4 / 60.0, rel=0.1)


def test_ultimate_gain_makes_the_loop_swing(model):
    """Poles of the closed loop lie on the unit circle at the ultimate gain, and turn with the ultimate period."""
    from optid.armax.loop import Gains as LoopGains
    from optid.armax.loop import close_loop

    found = ultimate(plant_of(model))
    poles = np.array(close_loop(model, LoopGains(found.gain)).poles)
    largest = poles[np.argmax(np.abs(poles))]
    assert abs(largest) == pytest.approx(1.0, abs=1e-4)
    assert 2 * np.pi * T / abs(np.angle(largest)) == pytest.approx(found.period, rel=1e-3)


def test_box_goes_there_and_back(task):
    within = box(
        ("kp", "ki", "kd", "setpoint_weight"), default_gains(task, ultimate(task.plant)), ultimate(task.plant)
    )
    points = np.random.default_rng(0).random((50, 4))
    np.testing.assert_allclose(within.points(within.gains(points)), points, atol=1e-9)
    h = 1e-6
    for j in range(4):
        moved = within.gains(points[0] + h * np.eye(4)[j]) - within.gains(points[0] - h * np.eye(4)[j])
        assert moved[0, within.places[j]] / (2 * h) == pytest.approx(within.slopes(points[0])[j], rel=1e-6)
    assert np.all(within.gains(np.zeros(4))[0, within.places] == 0.0)
    for bad in ((), ("kp", "kp"), ("kq",)):
        with pytest.raises(InputError):
            box(bad, Gains(1.0), ultimate(task.plant))
