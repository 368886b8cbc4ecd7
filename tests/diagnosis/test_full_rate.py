"""Decimated recordings are searched at their own rate where that reaches the noise, or where a mismatch is left."""

from types import SimpleNamespace

import pytest

from optid.core.checkpoint import Checkpoint
from optid.diagnosis import base_fit, pipeline
from optid.diagnosis.criteria import Criteria
from optid.diagnosis.problem import DiagnosisProblem
from optid.diagnosis.selection.path import SelectionPath

WHOLE, FEW = ("every sample",), ("every other",)


def problem(train):
    return DiagnosisProblem(None, train, {}, criteria=Criteria(), budget="of the search")


@pytest.mark.parametrize(
    ("decimated", "at_search", "at_full", "found", "asked", "kept"),
    [
        (True, 1.3, 1.0, {}, ["full"], "full"),  # it alone is at the noise
        (True, 1.3, 1.3, {"search": ("one", 1.0)}, ["search"], "search"),  # everything is found without it
        (True, 9.0, 1.3, {"search": ("one", 1.4), "full": ("other", 1.0)}, ["search", "full"], "full"),
        (True, 9.0, 1.38, {"search": ("one", 1.4)}, ["search"], "search"),  # the rate changes nothing
        (True, 9.0, 1.3, {"search": ("one", 1.4)}, ["search", "full"], "search"),  # there it falls
        (True, 1.3, 1.3, {"full": ("one", 1.0)}, ["search", "full"], "full"),  # nothing is found without it
        (True, 1.3, 1.3, {}, ["search", "full"], "search"),
        (True, 1.1, 1.0, {}, ["search"], "search"),  # nothing to look for
        (False, 9.0, 1.0, {}, ["search"], "search"),  # there is no other rate
    ],
)
def test_the_rate_of_the_search(monkeypatch, decimated, at_search, at_full, found, asked, kept):
    own = problem(WHOLE)
    search = problem(FEW) if decimated else own
    ratios = {FEW: at_search, WHOLE: at_full if decimated else at_search}
    searched = []

    def select(base, of, begun):
        rate = "full" if base == "refitted" else "search"
        searched.append(rate)
        assert of.budget == "of the search"
        assert of.train is (WHOLE if base == "refitted" else search.train)
        assert begun == (
            "refitted" if searched == ["search", "full"] else None
        )  # it goes on from what is found
        name, ratio = found.get(rate, ("", ratios[of.train]))
        best = SimpleNamespace(effects=(name,) if name else ())
        validated = SimpleNamespace(error_over_noise=ratio)
        return SelectionPath("base", best, None, validated, (rate,))

    monkeypatch.setattr(base_fit, "with_open_variance", lambda of, model: of)
    for module in (base_fit, pipeline):
        monkeypatch.setattr(
            module, "cross_validate", lambda model, of: SimpleNamespace(error_over_noise=ratios[of.train])
        )
        monkeypatch.setattr(module, "refit", lambda model, of: "refitted")
    monkeypatch.setattr(pipeline, "relax_bounds", lambda base, of: None)
    monkeypatch.setattr(pipeline, "select", select)
    monkeypatch.setattr(pipeline, "path_document", lambda path: {})
    path, of, wide = pipeline._select_at_either_rate("fitted", search, own, Checkpoint())
    assert searched == asked
    assert of.train is (WHOLE if kept == "full" else search.train)
    assert path.rounds == (asked[-1] if kept == "full" else "search",)
    assert path.earlier == (("search",) if kept == "full" and len(asked) == 2 else ())
    assert wide is None
