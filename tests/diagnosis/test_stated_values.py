"""The first step of the selection goes back to the rig file's values where what it found leaves a mismatch."""

from types import SimpleNamespace

import numpy as np
import pytest

from optid.core.budget import UNLIMITED
from optid.diagnosis.criteria import Criteria
from optid.diagnosis.selection import stepwise


def errors(ratio, loss):
    return SimpleNamespace(error_over_noise=ratio, windows=np.array([loss]))


def taken(ratio, loss):
    return SimpleNamespace(validated=errors(ratio, loss))


MODEL = SimpleNamespace(
    likelihood_problem=SimpleNamespace(model=SimpleNamespace(vector=lambda values: list(values.values())))
)
PROBLEM = SimpleNamespace(
    criteria=Criteria(), budget=UNLIMITED, rig=SimpleNamespace(parameters={"friction": 0.1})
)


@pytest.mark.parametrize(
    ("first", "other", "asked", "chosen"),
    [
        (None, taken(1.0, 1.0), True, "stated"),  # nothing was found: what is found from there is taken
        (taken(9.0, 5.0), taken(1.0, 1.0), True, "stated"),
        (taken(9.0, 5.0), taken(9.0, 6.0), True, "fitted"),
        (taken(9.0, 5.0), None, True, "fitted"),
        (taken(1.1, 5.0), taken(1.0, 1.0), False, "fitted"),  # at the noise: nothing to look for
    ],
)
def test_the_step_that_leaves_less_is_taken(monkeypatch, first, other, asked, chosen):
    begun = []

    def another(model, before, validated, problem, begin, below):
        assert below < 7.0  # no proposal is fitted fully that does not get nearer
        begun.append(begin)
        return SimpleNamespace(model=MODEL, taken=other, of="stated")

    monkeypatch.setattr(stepwise, "forward_step", another)
    proposals = SimpleNamespace(ranked=[SimpleNamespace(loss=7.0)])
    one = SimpleNamespace(model=MODEL, taken=first, of="fitted", proposals=proposals)
    found = stepwise._restarted_from_stated_values(one, errors(9.0, 8.0), PROBLEM)
    assert found.of == chosen
    assert begun == ([[0.1]] if asked else [])


def test_a_model_at_the_noise_is_left_alone(monkeypatch):
    monkeypatch.setattr(stepwise, "forward_step", None)
    one = SimpleNamespace(model=MODEL, taken=None)
    assert stepwise._restarted_from_stated_values(one, errors(1.1, 8.0), PROBLEM) is one
