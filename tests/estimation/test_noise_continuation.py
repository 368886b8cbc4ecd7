"""The smoother's process noise: every unit's own level, none of it where it explains nothing."""

import numpy as np
import pytest

from optid.errors import SolveError
from optid.estimation import noise_continuation as annealing
from optid.estimation.initial_trajectory import guess
from optid.estimation.noise_continuation import LEVELS, RUNG, TIGHT, Pace, Solution, anneal
from optid.estimation.objective import objective_of, with_nuisance_parameters
from optid.estimation.problem import build_problem
from optid.estimation.result import Outcome
from optid.estimation.smoother import Point
from tests.estimation.cart import RATE, SD, moved, record, rig

PACE = Pace(lambda stage, share: lambda iteration, cost, p: False, lambda: False, lambda at: None)


def posed(cart, data):
    problem = build_problem(cart.model, data, 0.1)
    o, p = objective_of(cart, with_nuisance_parameters(cart), problem)
    return o, Point(guess(cart.model, problem, p), p)


def test_noise_goes_where_the_model_errs(tmp_path):
    """Knocks on the cart change its speed, not its place: the speed's equation gets the process noise."""
    rng, dt = np.random.default_rng(11), 1 / RATE
    x, v, pieces = 0.0, 0.0, []
    push = np.repeat(rng.uniform(-1.0, 1.0, 40), 50)
    for piece in np.split(push, 20):
        *run, before, after = moved([*piece, 0.0, 0.0], dt, x, v)
        pieces.append(run)
        x, v = before, (after - before) / dt + 0.3 * rng.standard_normal()
    seen = np.concatenate(pieces) + SD * rng.standard_normal(len(push))
    o, at = posed(rig(tmp_path), [record(push, seen)])
    found = anneal(o, at, None, None, PACE)
    levels = dict(zip((state.name for state in o.model.states), found.q / o.model.scales, strict=True))
    assert found.outcome is Outcome.CONVERGED
    assert levels["velocity"] > 10.0 * levels["position"]


@pytest.mark.parametrize(
    ("best", "reached"),
    [((1.0, 1.0),) * 2, ((1.0, RUNG),) * 2, ((RUNG**-2, 1.0),) * 2, ((1e-5, 1e5), (RUNG**-4, RUNG**5))],
)
def test_every_unit_climbs_to_its_own_level(best, reached, monkeypatch, tmp_path):
    """One rung at a time, either way, within what the ladder spans."""
    o, at = posed(rig(tmp_path), [record(np.ones(200), moved(np.ones(200), 1 / 200))])
    aim = 1e-3 * np.array(best)

    def descended(o, at, terms, q, watch):
        levels = q / o.model.scales
        return Solution(o, at, terms, q, float((np.log(levels / aim) ** 2).sum()), Outcome.TIME_LIMIT)

    monkeypatch.setattr(annealing, "_descended", descended)
    start = descended(o, at, None, 1e-3 * o.model.scales, None)
    found = annealing._by_unit(o, start, 1.0, PACE)
    assert found.q / o.model.scales == pytest.approx(1e-3 * np.array(reached))
    assert (found.q / o.model.scales).min() >= TIGHT and (found.q / o.model.scales).max() <= LEVELS[0]


@pytest.mark.parametrize(("fails_at", "asked"), [(LEVELS[4], None), (LEVELS[0], None), (LEVELS[4], 1e-4)])
def test_a_level_that_cannot_be_solved_ends_the_way_down(fails_at, asked, monkeypatch, tmp_path):
    """The last looser level stands; without one, or where that very level was asked for, there is no answer."""
    o, at = posed(rig(tmp_path), [record(np.ones(200), moved(np.ones(200), 1 / 200))])

    def descended(o, at, terms, q, watch):
        level = float((q / o.model.scales)[0])
        if level < 1.001 * fails_at:
            raise SolveError("the normal equations are singular")
        return Solution(o, at, terms, q, level, Outcome.TIME_LIMIT)

    monkeypatch.setattr(annealing, "_descended", descended)
    monkeypatch.setattr(annealing, "_by_unit", lambda o, best, share, pace: best)
    monkeypatch.setattr(annealing, "_settled", lambda o, best, pace: best)
    if fails_at == LEVELS[0] or asked is not None:
        with pytest.raises(SolveError):
            anneal(o, at, None, asked, PACE)
    else:
        assert anneal(o, at, None, asked, PACE).q / o.model.scales == pytest.approx(LEVELS[3])


def test_a_level_too_loose_to_be_solved_leaves_the_start_to_the_next(monkeypatch, tmp_path):
    o, at = posed(rig(tmp_path), [record(np.ones(200), moved(np.ones(200), 1 / 200))])
    tried = []

    def descended(o, at, terms, q, watch):
        tried.append(float((q / o.model.scales)[0]))
        if tried[-1] > 0.02:
            raise SolveError("the normal equations are singular")
        return Solution(o, at, terms, q, tried[-1], Outcome.TIME_LIMIT)

    monkeypatch.setattr(annealing, "_descended", descended)
    monkeypatch.setattr(annealing, "_by_unit", lambda o, best, share, pace: best)
    monkeypatch.setattr(annealing, "_settled", lambda o, best, pace: best)
    assert anneal(o, at, None, None, PACE).q / o.model.scales == pytest.approx(LEVELS[-1])
    assert tried == pytest.approx(LEVELS)
