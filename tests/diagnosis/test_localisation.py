"""When an effect is at work: what it does beside a bypass, the intervals of that; where in state space it shows."""

from types import SimpleNamespace

import numpy as np
import pytest

from optid.core.recording import Channel, Recording
from optid.core.sheet import build
from optid.diagnosis.localisation.activity import effect_activity
from optid.diagnosis.localisation.region import _intervals, _range, by_usual_size
from optid.diagnosis.refinement import RefinedModel
from optid.rigs.rigfile import read_rig, with_effects
from tests.effects.plants import DATA, PLANTS, Grown, grown

COUNT = 400
EVERY = [(name, effect.name) for name in PLANTS for effect in grown(name).effects]


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
    answer = SimpleNamespace(
        p=improved.model.vector(improved.parameters),
        filtered=SimpleNamespace(states=[X]),
        likelihood_problem=SimpleNamespace(problem=SimpleNamespace(inputs=U)),
        noise=SimpleNamespace(measurement=np.ones(len(improved.model.outputs))),
    )
    return RefinedModel((), rig, None, None), RefinedModel(chosen, improved, answer, None)


def state(best, name):
    names = [state.name for state in best.rig.model.states]
    return best.fit.filtered.states[0][:, names.index(name)]


@pytest.mark.parametrize(("name", "effect"), EVERY)
def test_an_effect_is_at_work_and_at_its_null_it_is_not(name, effect):
    base, best = placed(name, (effect,))
    done = effect_activity(base, best, *best.effects)
    assert done.shape == (COUNT,)
    assert np.isfinite(done).all()
    assert (done > 0.2).any()
    base, best = placed(name, (effect,), usual=False)
    assert not effect_activity(base, best, *best.effects).any()


@pytest.mark.parametrize(("name", "effect"), EVERY)
def test_beside_a_bypass_the_plant_is_the_plain_one(name, effect):
    base, best = placed(name, (effect,))
    plain, answer = base.rig.model, best.fit
    own, ports = Grown(name, plain, best.rig.model, best.effects, {}).shared
    X, U = answer.filtered.states[0], answer.likelihood_problem.problem.inputs
    p = plain.vector(base.rig.parameters)
    changed = []
    for full, without, rows, by in (
        (best.rig.model.rates, plain.rates, own, plain.scales),
        (best.rig.model.sensors, plain.sensors, slice(None), np.ones(len(plain.outputs))),
    ):
        both = np.array(full.map(COUNT)(X.T, U.T, answer.p))[rows]
        more = both - np.array(without.map(COUNT)(X[:, own].T, U[:, ports].T, p))
        changed.append(
            np.linalg.norm(np.where(abs(more) > 1e-9 * abs(both), more, 0.0) / by[:, None], axis=0)
        )
    assert effect_activity(base, best, *best.effects) == pytest.approx(
        by_usual_size(*changed), rel=1e-3, abs=1e-3
    )


def test_of_two_at_one_site_each_is_told_by_itself():
    base, best = placed("servo-pneumatic", ("constant_force", "spring_load"))
    force, spring = best.effects if best.effects[0].name == "constant_force" else best.effects[::-1]
    assert set(force.sites) == set(spring.sites)
    assert effect_activity(base, best, force) == pytest.approx(np.ones(COUNT))
    assert np.ptp(effect_activity(base, best, spring)) > 0.5


def test_what_always_acts_is_always_at_work_and_what_acts_at_the_ends_is_there():
    both = ("constant_force", "end_cushioning")
    base, best = placed("servo-pneumatic", both)
    force, cushion = (next(e for e in best.effects if e.name == name) for name in both)
    assert effect_activity(base, best, force) == pytest.approx(np.ones(COUNT))
    at_end = np.abs(state(best, "position")) > 0.1
    works = effect_activity(base, best, cushion) > 0.2
    assert 0 < works.sum() < at_end.sum()
    assert at_end[works].all()


def test_the_usual_size_is_told_by_what_is_done_and_not_by_rest_or_a_jolt():
    rng = np.random.default_rng(5)
    size = np.abs(rng.normal(size=4000))
    plain = by_usual_size(size)
    # Half of what a normal variable does it does below sqrt(2 ln 2) sd.
    assert plain == pytest.approx(size / np.sqrt(2 * np.log(2)), rel=0.05)
    resting = by_usual_size(np.r_[size, np.zeros(40000), np.nan])
    assert resting[:4000] == pytest.approx(plain, rel=1e-12)
    assert resting[-1] == 0.0
    assert by_usual_size(np.r_[size, 100.0])[:4000] == pytest.approx(plain, rel=0.1)
    assert not by_usual_size(np.zeros(5)).any()
    # Of two kinds whichever is at work counts.
    assert by_usual_size(np.array([1.0, 1.0, 0.0]), np.array([0.0, 7.0, 7.0])).tolist() == [1.0, 1.0, 1.0]


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
