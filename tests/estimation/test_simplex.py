"""A simplex steps over what ends a descent, and leaves a place that is the best around alone."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from optid.errors import SolveError
from optid.estimation import scoring, simplex
from optid.estimation.likelihood import WHOLE
from optid.estimation.problem import pose
from optid.estimation.scoring import maximise, question_of
from tests.estimation.cart import recording, rig


@dataclass
class Hollow:
    """A bowl with its bottom at (1, 0, -2), and ripples that no slope leads out of."""

    coordinates: np.ndarray
    q = SimpleNamespace(free=(0, 1))

    @property
    def score(self):
        off = self.coordinates - np.array([1.0, 0.0, -2.0])
        return float(100.0 * off @ off + 8.0 * (1.0 - np.cos(60.0 * off[0])))


@pytest.fixture
def hollows(monkeypatch):
    monkeypatch.setattr(simplex, "_at", lambda here, coordinates: Hollow(np.array(coordinates)))


def test_it_steps_over_ripples(hollows):
    ripple = 2 * np.pi / 60.0
    start = Hollow(np.array([1.0 - 5 * ripple, 0.3, -1.0]))
    assert start.score > 100.0
    assert simplex.around(start).score < 3.0


def test_where_nothing_around_is_better_it_stays(hollows):
    best = Hollow(np.array([1.0, 0.0, -2.0]))
    assert simplex.around(best) is best


def test_a_place_that_cannot_be_simulated_is_passed_by(monkeypatch):
    def at(here, coordinates):
        if coordinates[0] < 0.9:
            raise SolveError("it leaves the numbers")
        return Hollow(np.array(coordinates))

    monkeypatch.setattr(simplex, "_at", at)
    assert simplex.around(Hollow(np.array([0.95, 0.2, -1.5]))).score < 3.0


def test_only_a_search_over_few_samples_looks_around(tmp_path, monkeypatch):
    cart, looked = rig(tmp_path), []
    q = question_of(cart, pose(cart.model, [recording(np.random.default_rng(1))], WHOLE), cart.model)
    p = cart.model.vector(cart.parameters)
    monkeypatch.setattr(scoring, "around", lambda here: looked.append(1) or here)
    monkeypatch.setattr(scoring, "FEW", len(q.problem.time) - 1)
    maximise(q, p, polish=False)
    assert not looked
    monkeypatch.setattr(scoring, "FEW", len(q.problem.time))
    maximise(q, p, polish=False)
    assert looked
