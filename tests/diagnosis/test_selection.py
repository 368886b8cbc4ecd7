"""Selection: who is fitted in full, and from where."""

from types import SimpleNamespace

import numpy as np

from optid.diagnosis.criteria import Criteria, SearchOptions
from optid.diagnosis.selection import forward, stepwise
from optid.diagnosis.selection.forward import fit_proposal, worth_fitting
from optid.diagnosis.selection.path import SelectionPath
from optid.diagnosis.surrogate import search
from optid.errors import SolveError


def proposal(loss, p=1.0):
    return SimpleNamespace(
        effect="e", likelihood_problem=SimpleNamespace(rig=None), p=np.array([p]), loss=loss
    )


def test_who_gains_too_little_is_not_fitted_beside_a_model_at_the_noise():
    problem = SimpleNamespace(options=SearchOptions(), criteria=Criteria())

    def worth(ranked, near, named=False):
        return worth_fitting(SimpleNamespace(ranked=ranked, alone=100.0), near, named, problem)

    ranked = [proposal(98.0), proposal(99.0), proposal(101.0)]
    assert worth(ranked, True) == ranked[:1]  # the test asks whether the best one gains anything
    assert worth(ranked, True, named=True) == []
    assert worth([proposal(95.0), *ranked], True, named=True)[1:] == []
    # Elsewhere the race goes under other gains than those of the model alone: the two losses do not compare.
    assert worth(ranked, False) == ranked
    far = [proposal(10.0), proposal(29.0), proposal(31.0)]
    assert worth(far, False) == far[:2]


def test_a_contender_goes_on_from_its_race_and_is_none_where_it_diverges(monkeypatch):
    losses = {1.0: 7.0}

    def turn(q, p, seconds, *, turns, steps, level, most):
        assert turns == most == 1
        if losses[float(p[0])] is None:
            raise SolveError("diverged")
        return SimpleNamespace(p=p, loss=losses[float(p[0])], level=level)

    monkeypatch.setattr(forward, "fit_multistep", turn)
    monkeypatch.setattr(forward, "fit_model", lambda problem, effects, rig, q, p, *, begun: float(begun.p[0]))
    current = SimpleNamespace(effects=(), fit=SimpleNamespace(level=-2.0))
    problem = SimpleNamespace(options=SearchOptions(), window=0.5)
    assert fit_proposal(current, problem, proposal(1.0)) == 1.0
    losses[1.0] = None
    assert fit_proposal(current, problem, proposal(1.0)) is None


def test_of_descriptions_only_the_best_is_fitted_fully_and_the_next_where_it_is_rejected(monkeypatch):
    full = []

    def contend(base, first, before, problem, tried, one, begun):
        full.append(begun.loss)
        return SimpleNamespace(why="too little" if begun.loss in rejected else "", loss=begun.loss)

    monkeypatch.setattr(
        search, "begin_proposal", lambda base, problem, one: one.effect and SimpleNamespace(loss=one.loss)
    )
    monkeypatch.setattr(search, "contend", contend)
    problem, led = (
        SimpleNamespace(options=SearchOptions()),
        [proposal(3.0), proposal(1.0), proposal(2.0), proposal(0.5)],
    )
    rejected = ()
    assert search._best(None, None, led, problem, 10).loss == 1.0  # the fourth of the race is not begun
    rejected = (1.0,)
    assert search._best(None, None, led, problem, 10).loss == 2.0
    assert full == [1.0, 1.0, 2.0]
    rejected = (1.0, 2.0, 3.0)
    assert search._best(None, None, led, problem, 10) is None


def test_the_nearest_is_the_contender_that_errs_least_in_any_round():
    def contender(loss):
        return SimpleNamespace(
            validated=SimpleNamespace(windows=np.array([loss, 1.0])), model=f"model {loss}"
        )

    rounds = [
        SimpleNamespace(contenders=tuple(contender(one) for one in some)) for some in ((5.0, 3.0), (4.0,), ())
    ]
    path = SelectionPath(None, None, None, None, tuple(rounds))
    assert path.nearest is rounds[0].contenders[1]
    assert path.strongest == "model 3.0"
    assert SelectionPath(None, None, None, None, ()).strongest is None


def test_a_search_goes_on_from_what_was_begun_and_compares_with_the_base(monkeypatch):
    """Two of three effects are there: one more step."""
    base, begun = SimpleNamespace(effects=()), SimpleNamespace(effects=("one", "two"))
    errors = {id(base): "of the base", id(begun): "of the begun"}
    asked = []

    def step(current, first, before, problem):
        asked.append((current, first, before))
        return SimpleNamespace(taken=None, contenders=())

    monkeypatch.setattr(stepwise, "cross_validate", lambda model, problem: errors[id(model)])
    monkeypatch.setattr(stepwise, "forward_step", step)
    monkeypatch.setattr(stepwise, "backward_elimination", lambda path, problem: path)
    problem = SimpleNamespace(
        criteria=Criteria(), budget=SimpleNamespace(is_over=False), report=lambda stage, words: None
    )
    path = stepwise.select(base, problem, begun)
    assert asked == [(begun, "of the base", "of the begun")]
    assert (path.base, path.best, path.first, path.validated) == (base, begun, "of the base", "of the begun")
