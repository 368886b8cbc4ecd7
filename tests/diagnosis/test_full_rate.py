"""The search runs at the recordings' own rate where decimation alone keeps the base fit from the noise."""

from types import SimpleNamespace

import pytest

from optid.diagnosis import base_fit
from optid.diagnosis.criteria import Criteria
from optid.diagnosis.problem import DiagnosisProblem


def problem(train):
    return DiagnosisProblem(None, train, {}, None, criteria=Criteria(), budget="of the search")


@pytest.mark.parametrize(
    ("decimated", "at_search", "at_full", "chosen"),
    [
        (True, 1.3, 1.0, "full"),
        (True, 1.3, 1.3, "search"),
        (True, 1.1, 1.0, "search"),
        (False, 9.0, 1.0, "search"),
    ],
)
def test_it_is_chosen_where_it_alone_is_at_the_noise(monkeypatch, decimated, at_search, at_full, chosen):
    whole, few = ("every sample",), ("every other",)
    own = problem(whole)
    search = problem(few) if decimated else own
    ratios = {few: at_search, whole: at_full if decimated else at_search}
    monkeypatch.setattr(
        base_fit,
        "cross_validate",
        lambda model, asked: SimpleNamespace(error_over_noise=ratios[asked.train]),
    )
    monkeypatch.setattr(base_fit, "with_open_variance", lambda asked, model: asked)
    monkeypatch.setattr(base_fit, "refit", lambda model, asked: "refitted")
    model, found = base_fit.at_full_rate("fitted", search, own)
    assert (model, found.train) == (("refitted", whole) if chosen == "full" else ("fitted", search.train))
    assert found.budget == "of the search"
