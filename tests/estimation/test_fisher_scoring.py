"""The likelihood search finds the closed form's parameters, and what it carries along is what a filter shows."""

from dataclasses import replace

import numpy as np
import pytest

from optid.core.budget import Budget
from optid.errors import SolveError
from optid.estimation import fisher_scoring as scoring
from optid.estimation import likelihood_point as place
from optid.estimation.fisher_scoring import (
    default_process_noise,
    likelihood_problem,
    maximise,
    point_at,
    successive_halving,
)
from optid.estimation.fixed_gain import fixed_gain_fit
from optid.estimation.likelihood import WHOLE, run_fixed_gain_filter
from optid.estimation.likelihood_point import Jacobians, LikelihoodPoint
from optid.estimation.problem import build_problem
from tests.estimation.cart import TRUTH, recording, rig


@pytest.fixture(scope="module")
def asked(tmp_path_factory):
    """The cart's two parameters asked of 8 s of its motion, and a start far from them."""
    cart = rig(tmp_path_factory.mktemp("cart"))
    data = [recording(np.random.default_rng(1))]
    problem = build_problem(cart.model, data, WHOLE)
    return likelihood_problem(cart, problem, cart.model), cart.model.vector(cart.parameters)


@pytest.fixture(scope="module")
def found(asked):
    q, p = asked
    return maximise(point_at(q, p, default_process_noise(q)))


def test_it_finds_the_truth_within_its_own_uncertainty(asked, found):
    q, _ = asked
    assert found.settled
    covariance = np.linalg.inv(found.information)[: len(q.free), : len(q.free)]
    for k, i in enumerate(q.free):
        error = (found.p[i] - TRUTH[q.model.parameters[i].name]) / q.typical[k]
        assert abs(error) < 3.5 * np.sqrt(covariance[k, k])
    # Nothing moves the states but the push: the noise of the states goes away.
    assert (found.noise.levels < np.log(0.02)).all()


def test_its_information_is_the_curvature_of_the_score(asked, found):
    q, _ = asked
    levels = found.noise.levels
    for k, i in enumerate(q.free):
        h = 3.0 / np.sqrt(found.information[k, k]) * q.typical[k]
        scores = []
        for side in (-1.0, 1.0):
            p = found.p.copy()
            p[i] += side * h
            scores.append(point_at(q, p, levels).score)
        curvature = (scores[0] + scores[1] - 2 * found.score) / h**2 * q.typical[k] ** 2
        assert curvature == pytest.approx(2 * found.information[k, k], rel=0.1)  # expected against seen


def test_carried_slopes_say_what_the_step_showed(asked):
    q, p = asked
    here = point_at(q, p, np.full(len(q.groups), -3.0))
    _, information = here.gradient_and_fisher()
    step = np.array([0.03, -0.02, *np.full(len(q.groups), 0.4)])
    there = here.moved(step)
    s = there.coordinates - here.coordinates
    slopes = here.broyden_update(there, information)
    seen = there.filtered.innovations[0] - here.filtered.innovations[0]
    known = np.isfinite(seen)
    assert (slopes.innovations @ s)[known] == pytest.approx(seen[known], abs=1e-12)
    # Across the step, in the metric of the information, nothing changes.
    across = np.array([1.0, *np.zeros(len(step) - 1)])
    across -= s * (across @ (np.diag(information) * s)) / (s @ (np.diag(information) * s))
    assert (slopes.innovations @ across)[known] == pytest.approx(
        (here.slopes.innovations @ across)[known], abs=1e-9
    )


def test_a_glance_sees_the_slopes_that_filters_show(asked, found, monkeypatch):
    """At small process noise gains hardly move with the parameters, and held ones show their slopes whole."""
    q, _ = asked
    glanced, whole = (point_at(q, found.p, np.full(len(q.groups), -5.0)) for _ in range(2))
    glanced.fixed_gain_jacobian()
    whole.differentiate()
    for k in range(len(q.free)):
        seen, true = (np.nan_to_num(one.slopes.innovations[..., k]).ravel() for one in (glanced, whole))
        assert seen @ true > 0.99 * np.linalg.norm(true) ** 2 > 0.0
    assert np.array_equal(
        glanced.slopes.innovations[..., len(q.free) :], whole.slopes.innovations[..., len(q.free) :]
    )
    # Where a model is lost beside the present one, filters show that column after all.
    steered = run_fixed_gain_filter

    def losing(model, problem, P, *others):
        E = steered(model, problem, P, *others)
        E[1, 5:] = np.inf
        return E

    monkeypatch.setattr(place, "run_fixed_gain_filter", losing)
    glanced.fixed_gain_jacobian()
    seen, true = (one.slopes.innovations[..., 0] for one in (glanced, whole))
    assert seen == pytest.approx(true, rel=1e-3, abs=1e-9, nan_ok=True)


def test_held_gains_lead_to_the_truth(asked):
    q, p = asked
    guide = point_at(q, p, np.full(len(q.groups), -3.0)).as_fit(False)
    near = fixed_gain_fit(q, p, q.model, guide.filtered, 15).p
    assert near[list(q.free)] == pytest.approx([TRUTH["gain"], TRUTH["drag"]], rel=0.02)
    others = [i for i in range(len(p)) if i not in q.free]
    assert np.array_equal(near[others], p[others])


def test_a_start_is_chosen_by_likelihood(asked, found):
    q, _ = asked
    loud = np.zeros(len(q.groups))
    p, levels = successive_halving(q, [(p, loud - by) for p in (asked[1], found.p) for by in (0.0, 2.0, 4.0)])
    assert p is found.p
    assert (levels == -4.0).all()


def test_a_race_of_starts_runs_the_losers_over_a_part_only(asked, found, tmp_path, monkeypatch):
    q, far = asked
    data = [recording(np.random.default_rng(k)) for k in (1, 2, 3)]
    three = replace(q, problem=build_problem(q.model, data, WHOLE))
    runs, whole = [], scoring.run_filter

    def counted(model, problem, P, *others, only):
        runs.append(len(P) * len(only))
        return whole(model, problem, P, *others, only=only)

    monkeypatch.setattr(scoring, "run_filter", counted)
    loud = np.zeros(len(q.groups))
    starts = [(p, loud - by) for p in (far, found.p) for by in (0.0, 4.0)]
    p, levels = successive_halving(three, starts)
    assert p is found.p
    assert (levels == -4.0).all()
    assert sum(runs) < len(starts) * len(data)
    assert point_at(three, p, levels).score == min(point_at(three, *one).score for one in starts)


def test_where_held_gains_mislead_whole_filters_show_the_way(asked, found, monkeypatch):
    q, far = asked

    def misled(self):
        self.differentiate()
        self.slopes = Jacobians(-self.slopes.innovations, -self.slopes.variances)
        self.fresh = self.glanced = True

    monkeypatch.setattr(LikelihoodPoint, "fixed_gain_jacobian", misled)
    start = point_at(q, far, default_process_noise(q)).score
    assert maximise(point_at(q, far, default_process_noise(q))).score < found.score + 0.1 * (
        start - found.score
    )


def test_a_search_whose_budget_is_over_stays_where_it_is(asked):
    q, p = asked
    over = replace(q, budget=Budget(time_limit=0.0))
    assert np.array_equal(maximise(point_at(over, p, np.full(len(q.groups), -5.0))).p, p)


def test_a_start_without_numbers_is_refused(asked):
    q, p = asked
    broken = p.copy()
    broken[q.free[0]] = np.nan
    with pytest.raises(SolveError, match="diverged at the start"):
        point_at(q, broken, default_process_noise(q))
