"""Intervals where a parameter stands at a bound: what it cannot do, the others need not make up for."""

from types import SimpleNamespace

import numpy as np
import pytest

from optid.diagnosis.intervals import intervals, joint_p_value


def refined(values, low, high):
    """A line a + b t in white noise, of two parameters that are hard to tell apart."""
    t = np.linspace(1.0, 1.2, 200)
    slopes = np.stack([np.ones_like(t), t], axis=1)[:, None, :]
    parameters = [SimpleNamespace(name=name, unit="1", nuisance=None) for name in "ab"]
    model = SimpleNamespace(parameters=parameters, known_bias=lambda free, values: np.zeros(len(free)))
    problem = SimpleNamespace(
        recording=np.array([0]), counts=np.array([199]), time=np.arange(200) * 0.1, dt=np.full(199, 0.1)
    )
    likelihood_problem = SimpleNamespace(
        free=(0, 1),
        typical=np.ones(2),
        low=np.array(low),
        high=np.array(high),
        prior=np.full(2, np.nan),
        prior_sd=np.full(2, np.inf),
        model=model,
        problem=problem,
    )
    noise = np.random.default_rng(0).standard_normal((1, 200, 1))
    answer = SimpleNamespace(
        likelihood_problem=likelihood_problem,
        p=np.array(values),
        gradient=np.zeros(2),
        information=slopes[:, 0].T @ slopes[:, 0],
        filtered=SimpleNamespace(innovations=noise, variances=np.ones((1, 200, 1))),
        slopes=SimpleNamespace(innovations=-slopes, variances=np.zeros_like(slopes)),
    )
    return SimpleNamespace(fit=answer, effects=(), shift=np.zeros(2))


def half(estimate):
    return (estimate.high - estimate.low) / 2


def test_a_bound_that_holds_a_parameter_takes_its_freedom_from_the_other():
    free, _ = intervals(refined([0.0, 0.5], [-1e6, -1e6], [1e6, 1e6]), 1.0)
    held, at = intervals(refined([0.0, 0.5], [-1e6, 0.5], [1e6, 1e6]), 1.0)
    assert half(free) > 10.0 * half(held)
    assert half(held) == pytest.approx(1.96 / np.sqrt(200), rel=0.6)  # as if the other were known
    assert at.low == 0.5 and at.high > 0.6  # the one at its bound is as unsure as ever


def test_what_a_search_had_left_to_go_counts_as_another_sd():
    there = refined([0.5, 0.5], [-5.0, -5.0], [5.0, 5.0])
    plain = intervals(there, 1.0)
    step = np.array([0.3, -0.2])
    there.fit.gradient = there.fit.information @ step
    wider = intervals(there, 1.0)
    for one, before, left in zip(wider, plain, step, strict=True):
        sd = (before.high - before.low) / 2 / 1.959964
        assert (one.high - one.low) / 2 == pytest.approx(1.959964 * np.hypot(sd, left), rel=1e-6)


def test_a_parameter_at_its_bound_has_nowhere_to_go():
    there = refined([0.5, -5.0], [-5.0, -5.0], [5.0, 5.0])
    plain = [(one.low, one.high) for one in intervals(there, 1.0)]
    there.fit.gradient = np.array([0.0, 100.0])
    assert [(one.low, one.high) for one in intervals(there, 1.0)] == plain


def test_a_nuisance_parameter_at_its_bound_shifts_what_makes_up_for_it():
    """The best a is at b's bound; were it not for this, both would go on."""
    there = refined([0.5, -5.0], [-5.0, -5.0], [5.0, 5.0])
    there.fit.gradient = np.array([0.0, 0.3])
    held, _ = intervals(there, 1.0)
    there.fit.likelihood_problem.model.parameters[1].nuisance = object()
    wider, _ = intervals(there, 1.0)
    left = np.linalg.solve(there.fit.information, there.fit.gradient)[0]
    assert abs(left) > half(held)
    assert half(wider) == pytest.approx(np.hypot(half(held), 1.959964 * left), rel=1e-6)


def test_what_the_data_do_not_show_is_not_identifiable():
    """A parameter without influence has no interval but its bounds; two that act alike have none either."""
    there = refined([0.5, 0.5], [-5.0, -5.0], [5.0, 5.0])
    there.fit.slopes.innovations[..., 1] = 0.0
    there.fit.information = np.diag([200.0, 0.0])
    shown, idle = intervals(there, 1.0)
    assert shown.identifiable and half(shown) < 0.5
    assert not idle.identifiable and (idle.low, idle.high) == (-5.0, 5.0)
    there.fit.information = np.full((2, 2), 200.0)
    for one in intervals(there, 1.0):
        assert not one.identifiable and (one.low, one.high) == (-5.0, 5.0)
    at_bound = refined([0.5, 5.0], [-5.0, -5.0], [5.0, 5.0])
    at_bound.fit.information = np.full((2, 2), 200.0)
    known, _ = intervals(at_bound, 1.0)  # its twin stands at a bound
    assert known.identifiable and half(known) < 0.5


def test_recordings_that_contradict_each_other_widen_what_they_contradict():
    """Two recordings of the same line: one sees an offset that the other does not."""
    there = refined([0.0, 0.5], [-5.0, -5.0], [5.0, 5.0])
    answer, problem = there.fit, there.fit.likelihood_problem.problem
    problem.recording, problem.counts = np.array([0, 1]), np.array([99, 99])
    slopes = np.stack([np.ones(200), np.tile([-1.0, 1.0], 100)], axis=1)[
        :, None, :
    ]  # of independent parameters
    answer.slopes.innovations, answer.information = -slopes, slopes[:, 0].T @ slopes[:, 0]
    _, before = intervals(there, 1.0)
    answer.filtered.innovations = answer.filtered.innovations + np.repeat([0.5, -0.5], 100)[None, :, None]
    offset, other = intervals(there, 1.0)
    # The estimates lie about 0.5 on either side of the common one, and one has an sd of a tenth.
    noise = answer.filtered.innovations[0, :, 0]
    birge = abs(noise[:100].mean() - noise[100:].mean()) / np.sqrt(2.0) / 0.1
    assert birge > 5.0
    assert half(offset) == pytest.approx(1.959964 * birge / np.sqrt(200), rel=0.1)
    assert half(other) == pytest.approx(half(before), rel=0.1)


def line(values, low=(-1e6, -1e6), high=(1e6, 1e6)):
    """The line as an effect whose strengths are both of its parameters."""
    effect = SimpleNamespace(name="line", strength={"a": 0.1, "b": 0.1}, at_null=lambda: {"a": 0.0, "b": 0.0})
    there = refined(values, list(low), list(high))
    for one in there.fit.likelihood_problem.model.parameters:
        one.name = f"line.{one.name}"
    return there, effect


def test_strengths_that_make_up_for_each_other_are_away_from_none_together():
    """Half as high as its noise at 200 samples is seven sd; its level and its slope are less than one each."""
    there, effect = line([0.3, 0.2])
    assert all(one.low < 0.0 < one.high for one in intervals(there, 1.0))
    assert joint_p_value(there, effect, 1.0) < 1e-9
    assert joint_p_value(there, effect, 5.0) == pytest.approx(0.37, abs=0.15)  # a misfit counts here, too
    assert joint_p_value(there, effect, np.inf) == 1.0
    nothing, effect = line([0.0, 0.0])
    assert joint_p_value(nothing, effect, 1.0) == pytest.approx(1.0)
    at_bounds, effect = line([0.3, 0.2], low=(0.3, 0.2))
    assert joint_p_value(at_bounds, effect, 1.0) == 1.0


def test_a_misfit_widens_intervals_once():
    """Errors of three times the noise: the blocks' scores show them, and the ratio says them again."""
    there = refined([0.0, 0.5], [-1e6, -1e6], [1e6, 1e6])
    plain = [half(one) for one in intervals(there, 1.0)]
    there.fit.filtered.innovations = 3.0 * there.fit.filtered.innovations
    by_scores = [half(one) for one in intervals(there, 1.0)]
    assert all(1.5 * before < wide for before, wide in zip(plain, by_scores, strict=True))
    assert [half(one) for one in intervals(there, 1.5)] == pytest.approx(by_scores)
    by_ratio = [half(one) for one in intervals(there, 50.0)]
    assert [half(one) for one in intervals(there, 100.0)] == pytest.approx([2.0 * one for one in by_ratio])


def test_a_model_that_diverged_has_no_interval_but_its_bounds():
    there = refined([0.5, 0.5], [-5.0, -5.0], [5.0, 5.0])
    assert [(one.low, one.high) for one in intervals(there, np.inf)] == [(-5.0, 5.0)] * 2


def test_what_a_plant_states_of_its_smooth_laws_counts_as_another_sd():
    there = refined([0.5, 0.5], [-5.0, -5.0], [5.0, 5.0])
    before = intervals(there, 1.0)
    there.fit.likelihood_problem.model.known_bias = lambda free, values: np.array([0.2, 0.0])
    one, other = intervals(there, 1.0)
    assert half(one) == pytest.approx(np.hypot(half(before[0]), 1.959964 * 0.2), rel=1e-6)
    assert half(other) == half(before[1])
