"""Tests with a stated error rate: how often they speak where nothing is gained, and that they do where something is."""

import math
from dataclasses import replace

import numpy as np
import pytest

from optid.diagnosis import validation
from optid.diagnosis.criteria import Criteria
from optid.diagnosis.fitted import FittedModel
from optid.diagnosis.problem import DiagnosisProblem
from optid.diagnosis.validation import Validated, _folds, flipped_signs, p_value, rejection_reason

DRAWS = 4000


@pytest.mark.parametrize("count", [15, 45])
@pytest.mark.parametrize("tail", [2.0, 30.0])
def test_gains_that_are_none_pass_no_more_often_than_the_level(count, tail):
    rng = np.random.default_rng(count)
    p = np.array([flipped_signs(rng.standard_t(tail, count)) for _ in range(DRAWS)])
    for level in (0.01, 0.05):
        assert np.mean(p <= level) <= level + 3.0 * np.sqrt(level / DRAWS)


def test_a_gain_in_most_windows_shows():
    rng = np.random.default_rng(1)
    assert flipped_signs(1.0 + 0.5 * rng.standard_normal(15)) < 0.01


def test_one_window_carries_no_verdict_by_signs_but_by_likelihood_where_the_noise_is_reached():
    before, after = np.full(15, 0.5), np.full(15, 0.5)
    before[3] = 200.0
    assert p_value(before, after, at_noise=False) > 0.05
    assert p_value(before, after, at_noise=True) < 1e-6


def test_nothing_gained_is_no_proof():
    same = np.full(15, 0.5)
    assert p_value(same, same, at_noise=True) == 1.0
    assert p_value(same, 2.0 * same, at_noise=True) == 1.0


def test_a_gain_in_a_third_of_few_windows_shows_though_others_lose_a_little():
    """Friction that is wrong in one direction only: the bound alone would ask for twice as long a recording."""
    gains = np.array([-0.5] * 16 + [18.6, 33.5, 33.8, 24.7, 21.2, 33.6, 33.8, 21.9, 3.0])
    assert 2.0 * flipped_signs(gains) < 0.01
    exact = flipped_signs(np.full(9, 1.0))
    assert exact == pytest.approx(2.0**-9, rel=0.4)


def test_every_fold_leaves_some_of_every_recording_to_learn_from():
    """An effect may act in one recording only: parameters fitted to the others know nothing of it."""
    recording, time = (
        np.repeat([0, 1, 2], [600, 300, 900]),
        np.concatenate([np.arange(n) for n in (600, 300, 900)]),
    )
    fold = _folds(recording, time.astype(float), ())
    for one in np.unique(fold):
        for each in np.unique(recording):
            assert 0.2 < np.mean(fold[recording == each] == one) < 0.5
    assert set(_folds(recording, time.astype(float), (2,))[recording != 2]) == {-1}


@pytest.mark.parametrize(
    ("first", "before", "after", "named"),
    [(5.0, 5.0, 1.0, True), (5.0, 5.0, 2.0, False), (9.0, 5.0, 1.0, False), (1.1, 1.1, 1.0, False)],
)
def test_a_small_effect_is_named_only_if_it_alone_brings_the_model_to_the_noise(first, before, after, named):
    rng = np.random.default_rng(0)
    same = first == before
    validated = {
        ratio: Validated(ratio**2 * rng.uniform(0.9, 1.1, (45, 1))) for ratio in {first, before, after}
    }
    plain = validated[first]
    without = plain if same else validated[before]
    why = rejection_reason(0.7, plain, without, validated[after], Criteria(), 30, alone=same)
    assert (why == "") is named
    assert named or why.startswith("the fit leaves it at 70 % of the smallest size")


def test_a_model_is_validated_once_for_each_problem(monkeypatch):
    asked = []
    monkeypatch.setattr(
        validation, "_cross_validated", lambda model, problem: asked.append(problem) or len(asked)
    )
    model, first = FittedModel((), None, None), DiagnosisProblem(None, (), {})
    other = replace(first, open_variance=np.ones(1))
    found = [validation.cross_validate(model, one) for one in (first, other, first)]
    assert found == [1, 2, 1]
    assert asked == [first, other]
    assert validation.cross_validate(FittedModel((), None, None), first) == 3


def test_a_gain_that_cannot_be_computed_is_refused(monkeypatch):
    """NaN is neither less nor more than anything: no comparison may take it for a gain."""
    monkeypatch.setattr(validation, "error_gain", lambda before, after: math.nan)
    first, better = Validated(np.full((20, 1), 9.0)), Validated(np.full((20, 1), 0.9))
    assert rejection_reason(5.0, first, first, better, Criteria(), 1, True)
