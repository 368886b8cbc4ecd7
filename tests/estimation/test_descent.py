"""The descent of a state estimate: a step that is refused is tried shorter, also where no parameter is free."""

from types import SimpleNamespace

import numpy as np
import pytest

from optid.core.model import Array
from optid.estimation import smoother
from optid.estimation.smoother import Point, Terms


def terms(cost: float) -> Terms:
    empty: Array = np.zeros(0)
    return Terms(empty, empty, empty, empty, empty, empty, cost)


def test_a_refused_step_is_tried_shorter_though_no_parameter_moves(monkeypatch):
    """|x - 1|, whose undamped step goes ten times too far."""
    o = SimpleNamespace(model=SimpleNamespace(scales=np.ones(1)), free=())

    def step(o, at, t, q, damping):
        return Point(at.X - 10.0 * (at.X - 1.0) / (1.0 + 1e4 * damping), at.p), 0.0, t.cost

    monkeypatch.setattr(smoother, "_step", step)
    monkeypatch.setattr(smoother, "evaluate", lambda o, at, q: terms(float(np.abs(at.X - 1.0).sum())))
    found, last, _ = smoother.descend(o, Point(np.array([[3.0]]), np.zeros(0)), np.ones(1), precision=1e-6)
    assert found.X[0, 0] == pytest.approx(1.0, abs=1e-3) and last.cost < 1e-3
