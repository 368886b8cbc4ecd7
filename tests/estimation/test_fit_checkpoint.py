"""A fit goes on from its own stand alone: whole, of the same data and equations."""

import json
from dataclasses import replace

import numpy as np
import pytest

from optid.core.checkpoint import Checkpoint
from optid.core.sheet import build
from optid.estimation.checkpoint import Kept, key_of, load, save
from optid.estimation.objective import objective_of
from optid.estimation.problem import build_problem
from optid.estimation.smoother import Point
from tests.estimation.cart import DRAG, GAIN, SHARE, recording, rig


@pytest.fixture
def objective(tmp_path):
    cart = rig(tmp_path)
    data = recording(np.random.default_rng(0), seconds=2.0)
    return objective_of(cart, (), build_problem(cart.model, [data], 0.5))[0]


def kept(o):
    p = np.array([2.0, 1.0, 1.0])
    return p, Kept(1, Point(np.full((4, 2), np.pi), p), Point(np.full((4, 2), 1 / 3), 2 * p))


def test_it_comes_back_to_the_last_bit(objective, tmp_path):
    p, stand = kept(objective)
    path = tmp_path / "fit.part.json"
    save(Checkpoint(path, key_of(objective, p)), stand)
    found = load(Checkpoint(path, key_of(objective, p)))
    assert found.number == 1
    assert np.array_equal(found.at.X, stand.at.X)
    assert np.array_equal(found.best.p, stand.best.p)


def test_a_changed_number_is_no_stand(objective, tmp_path):
    p, stand = kept(objective)
    path = tmp_path / "fit.part.json"
    checkpoint = Checkpoint(path, key_of(objective, p))
    save(checkpoint, stand)
    document = json.loads(path.read_text())
    document["stages"]["fit"]["at"]["p"][0] = 7.0
    path.write_text(json.dumps(document))
    assert load(checkpoint) is None
    path.write_text(path.read_text()[:-20])
    assert load(checkpoint) is None


def other_cart(s):
    """The cart of the tests with other equations, under the same names."""
    x, v = s.state("position", "m", 0.1, spread=0.1), s.state("velocity", "m/s", 1.0)
    s.rate(x, v)
    s.rate(v, s.param(SHARE) * s.param(GAIN) * s.input("command", "1") - s.param(DRAG) * v * v)
    s.output("position", "m", x)


def test_a_plant_that_was_edited_begins_anew(objective, tmp_path):
    p, stand = kept(objective)
    path = tmp_path / "fit.part.json"
    save(Checkpoint(path, key_of(objective, p)), stand)
    edited = replace(objective, model=replace(build(other_cart), name=objective.model.name))
    assert load(Checkpoint(path, key_of(edited, p))) is None
