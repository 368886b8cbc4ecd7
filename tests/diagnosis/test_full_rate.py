"""Decimated recordings are searched at their own rate where that reaches the noise, or where nothing is found."""

from types import SimpleNamespace

import pytest

from optid.core.checkpoint import Checkpoint
from optid.diagnosis import base_fit, pipeline
from optid.diagnosis.criteria import Criteria
from optid.diagnosis.problem import DiagnosisProblem

WHOLE, FEW = ("every sample",), ("every other",)


def problem(train):
    return DiagnosisProblem(None, train, {}, criteria=Criteria(), budget="of the search")


@pytest.mark.parametrize(
    ("decimated", "at_search", "at_full", "named_at", "asked", "kept"),
    [
        (True, 1.3, 1.0, "full", ["full"], "full"),  # it alone is at the noise
        (True, 1.3, 1.3, "search", ["search"], "search"),  # something is found without it
        (True, 1.3, 1.3, "full", ["search", "full"], "full"),  # nothing is found without it
        (True, 1.3, 1.3, "neither", ["search", "full"], "search"),
        (True, 1.1, 1.0, "neither", ["search"], "search"),  # nothing to look for
        (False, 9.0, 1.0, "neither", ["search"], "search"),  # there is no other rate
    ],
)
def test_the_rate_of_the_search(monkeypatch, decimated, at_search, at_full, named_at, asked, kept):
    own = problem(WHOLE)
    search = problem(FEW) if decimated else own
    ratios = {FEW: at_search, WHOLE: at_full if decimated else at_search}
    searched = []

    def select(base, of):
        rate = "full" if base == "refitted" else "search"
        searched.append(rate)
        assert of.budget == "of the search"
        assert of.train is (WHOLE if base == "refitted" else search.train)
        best = SimpleNamespace(effects=("one",) if rate == named_at else ())
        validated = SimpleNamespace(error_over_noise=ratios[of.train])
        return SimpleNamespace(best=best, validated=validated, ended_early=False)

    monkeypatch.setattr(
        base_fit, "cross_validate", lambda model, of: SimpleNamespace(error_over_noise=ratios[of.train])
    )
    monkeypatch.setattr(base_fit, "with_open_variance", lambda of, model: of)
    monkeypatch.setattr(base_fit, "refit", lambda model, of: "refitted")
    monkeypatch.setattr(pipeline, "relax_bounds", lambda base, of: None)
    monkeypatch.setattr(pipeline, "select", select)
    monkeypatch.setattr(pipeline, "path_document", lambda path: {})
    _, found, wide = pipeline._select_at_either_rate("fitted", search, own, Checkpoint())
    assert searched == asked
    assert found.train is (WHOLE if kept == "full" else search.train)
    assert wide is None
