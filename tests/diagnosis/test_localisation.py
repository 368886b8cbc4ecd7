"""When an effect acts, by what it changes over the next samples; the intervals of that; where in state space it is."""

from types import SimpleNamespace

import numpy as np
import pytest

from optid.core.recording import Channel, Recording
from optid.core.sheet import build
from optid.diagnosis.localisation import activity
from optid.diagnosis.localisation.activity import effect_activity, share_of_largest
from optid.diagnosis.localisation.region import _inside, _intervals, _range, region
from optid.diagnosis.refinement import RefinedModel
from optid.rigs.rigfile import read_rig, with_effects
from tests.effects.plants import DATA, PLANTS, Grown, grown

COUNT = 400
SOME = (
    "constant_force",
    "stribeck_friction",
    "end_cushioning",
    "cross_leakage",
    "valve_lag",
    "sensor_backlash",
)


def placed(name, effects, usual=True):
    """A plant with effects at their first usual point or at null, at random states; without them."""
    rig = read_rig(DATA / PLANTS[name][1])
    chosen = tuple(next(e for e in grown(name).effects if e.name == effect) for effect in effects)
    values = {}
    for effect in chosen:
        values |= effect.qualified(effect.usual[0] if usual else effect.at_null())
    improved, rng = with_effects(rig, chosen, values), np.random.default_rng(4)
    plant = Grown(name, build(PLANTS[name][0]), improved.model, chosen, {})
    X, U = plant.states(rng, COUNT), plant.inputs(rng, COUNT)
    problem = SimpleNamespace(
        inputs=U,
        dt=np.full(COUNT, 1e-3),
        begins=np.array([0]),
        counts=np.array([COUNT - 1]),
        recording=np.array([0]),
        time=np.arange(COUNT) * 1e-3,
    )
    noise = np.ones(len(improved.model.outputs))
    answer = SimpleNamespace(
        p=improved.model.vector(improved.parameters),
        filtered=SimpleNamespace(states=[X]),
        likelihood_problem=SimpleNamespace(problem=problem, measurement=noise, model=improved.model),
    )
    return RefinedModel(chosen, improved, answer, None)


def state(best, name):
    names = [state.name for state in best.rig.model.states]
    return best.fit.filtered.states[0][:, names.index(name)]


@pytest.mark.parametrize("name", SOME)
def test_an_effect_acts_and_at_its_null_it_does_not(name):
    best = placed("servo-pneumatic", (name,))
    done = effect_activity(best, *best.effects)
    assert done.shape == (COUNT,)
    assert np.isfinite(done).all()
    assert (done > 0.2).any()
    best = placed("servo-pneumatic", (name,), usual=False)
    assert not effect_activity(best, *best.effects).any()


def test_what_always_acts_acts_always_and_what_acts_at_the_ends_acts_there():
    both = ("constant_force", "end_cushioning")
    best = placed("servo-pneumatic", both)
    force, cushion = (next(e for e in best.effects if e.name == name) for name in both)
    assert effect_activity(best, force) == pytest.approx(np.ones(COUNT), abs=0.9)
    at_end = np.abs(state(best, "position")) > 0.1
    works = effect_activity(best, cushion) > 0.1
    assert 0 < works.sum() < at_end.sum()
    assert at_end[:: activity.AHEAD][works[:: activity.AHEAD]].all()


def test_a_spring_does_as_much_as_its_force():
    """While the load moves and does not turn, k x t / m is added to its speed."""
    best = placed("servo-pneumatic", ("spring_load",))
    x, v = (np.abs(state(best, name))[:: activity.AHEAD] for name in ("position", "velocity"))
    moving = (v > 0.3) & (x > 0.01)
    per_metre = effect_activity(best, *best.effects)[:: activity.AHEAD][moving] / x[moving]
    assert moving.sum() > 10
    # Random pressures turn some of them within the five samples.
    assert np.quantile(per_metre, [0.3, 0.8]) == pytest.approx(np.median(per_metre), rel=0.1)


def test_the_largest_is_each_recording_s_own_and_no_jolt():
    rng = np.random.default_rng(5)
    size = np.abs(rng.normal(size=4000))
    owner = np.repeat([0, 1, 2], [4000, 4000, 100])
    done = share_of_largest(np.r_[size, 0.1 * size, np.full(100, 1e-6)], owner)
    assert done[:4000] == pytest.approx(size / np.quantile(size, 0.99), rel=0.01)
    assert done[4000:8000] == pytest.approx(done[:4000], rel=1e-3)
    assert not done[8000:].any()
    jolt = share_of_largest(np.r_[size, 100.0, np.nan], np.zeros(4002, dtype=int))
    assert jolt[:4000] == pytest.approx(done[:4000], rel=0.05)
    assert jolt[-1] == 0.0
    assert not share_of_largest(np.zeros(5), np.zeros(5, dtype=int)).any()
    seldom = share_of_largest(np.r_[np.zeros(5000), np.ones(10)], np.zeros(5010, dtype=int))
    assert (seldom > 0.1).sum() == 10


def law_of(name, **values):
    effect = next(e for e in grown("servo-pneumatic").effects if e.name == name)
    return effect.active_range({**effect.at_null(), **effect.usual[0], **values}, {"stroke": 0.26})


@pytest.mark.parametrize(("exponent", "tail"), [(1.0, 0.01), (2.0, 1.0), (1.5, 0.1)])
def test_stribeck_s_range_ends_where_a_tenth_is_left(exponent, tail):
    (low, high) = law_of("stribeck_friction", stribeck_speed=0.02, exponent=exponent, tail=tail)["velocity"]
    assert low == -high
    z = (high / 0.02) ** exponent
    assert (1.0 + tail * z) ** (-1.0 / tail) == pytest.approx(0.1, rel=1e-9)


def test_ranges_that_laws_single_out():
    assert law_of("valve_deadband", width=0.03) == {"command": (-0.03, 0.03)}
    assert law_of("valve_underlap", width=0.0) == {}
    assert law_of("end_cushioning", length=0.02, side=1.0)["position"] == pytest.approx((0.11, 0.13))
    assert law_of("end_cushioning", length=0.02, side=-1.0)["position"] == pytest.approx((-0.13, -0.11))
    assert law_of("end_cushioning", length=0.02, side=0.0) == {}
    assert law_of("constant_force") == {}
    flat = {"slope_ahead": 0.0, "slope_behind": 0.0, "place": 0.04, "width": 0.02, "ending": 50.0}
    low, high = law_of("position_dependent_friction", rise=0.3, **flat)["position"]
    assert (1 - ((high - 0.04) / 0.02) ** 2 / 50) ** 50 == pytest.approx(0.1, rel=1e-6)
    assert low + high == pytest.approx(0.08)
    ahead = law_of("position_dependent_friction", rise=0.0, **{**flat, "slope_ahead": 3.0})["position"]
    assert ahead == (0.04, np.inf)
    both = {**flat, "slope_ahead": 3.0, "slope_behind": 3.0}
    assert law_of("position_dependent_friction", rise=0.0, **both) == {}


def test_a_stated_range_ends_where_the_signal_does_and_has_its_shares():
    values, energy = np.linspace(-1.0, 1.0, 2001), np.r_[np.zeros(1000), np.ones(1001)]
    found = _inside((0.5, np.inf), values, energy, "V", 1.0)
    assert (found.low, found.high, found.unit) == (0.5, 1.0, "V")
    assert found.share == pytest.approx(0.5, abs=2e-3) and found.occupancy == pytest.approx(0.25, abs=2e-3)
    assert _inside((-0.1, 0.1), values, energy, "V", 5.0).high == pytest.approx(0.5)


def found_in(best, within, active):
    """The region of a mismatch that is the same everywhere."""
    time = np.arange(COUNT) * 1e-3
    recording = Recording("a", time, {"position": Channel("position", "x", "m", time)})
    mismatch = np.ones((COUNT, len(best.rig.model.outputs)))
    return region(best.fit, mismatch, active, (recording,), within)


def test_the_range_of_the_law_takes_the_place_of_the_mismatch_s():
    best, active = placed("servo-pneumatic", ("stribeck_friction",)), np.ones(COUNT)
    slow = found_in(best, {"velocity": (-0.05, 0.05)}, active).states
    assert (slow["velocity"].low, slow["velocity"].high) == (-0.05, 0.05)
    assert slow["velocity"].by_law and not slow["position"].by_law
    plain = found_in(best, {}, active).states["velocity"]
    assert not plain.by_law
    assert plain.high - plain.low > 0.1


def test_what_is_active_nearly_all_the_time_always_is():
    best, active = placed("servo-pneumatic", ("constant_force",)), np.ones(COUNT)
    active[100:104] = 0.0
    assert found_in(best, {}, active).always
    active[100:200] = 0.0
    assert not found_in(best, {}, active).always


def test_intervals_join_what_is_soon_at_work_again_and_keep_to_their_recording():
    time = np.arange(100) * 0.01
    two = [Recording(name, time, {"position": Channel("position", "x", "m", time)}) for name in ("a", "b")]
    works = np.zeros(200, dtype=bool)
    works[[10, 11, 12, 15, 16, 40]] = True  # 0.02 s away, and 0.23 s
    works[95:105] = True  # across the recordings
    works[199] = True  # its last sample, which lasts for nothing
    found = _intervals(works, np.repeat([0, 1], 100), np.tile(time, 2), tuple(two), 0.05)
    assert found == (("a", 0.1, 0.17), ("a", 0.4, 0.41), ("a", 0.95, 0.99), ("b", 0.0, 0.05))


def test_a_range_holds_most_of_the_mismatch_with_the_fewest_samples():
    rng = np.random.default_rng(3)
    v = rng.uniform(-1, 1, 20_000)
    energy = np.where(np.abs(v - 0.3) < 0.1, 1.0, 0.01)
    found = _range(v, energy, "m/s")
    assert found.low == pytest.approx(0.2, abs=0.06)
    assert found.high == pytest.approx(0.4, abs=0.06)
    assert found.share >= 0.8
    assert found.occupancy < 0.2
