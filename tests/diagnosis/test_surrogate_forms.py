"""Which forms are worth a fit: a curve over what was visited without gaps."""

from types import SimpleNamespace

import numpy as np
import pytest

from optid.diagnosis.surrogate import library
from optid.diagnosis.surrogate.library import _filled, curves

T = np.arange(3000) * 1e-2


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        (np.sin(T), True),
        (np.where(T < 15, T, 15.0), True),  # it stops at an end
        (np.random.default_rng(0).normal(size=3000).clip(-2, 2), True),
        (np.sin(T) ** 15, True),  # a speed is seldom near its extremes, but it is there
        (np.repeat([1.0, 3.0, 7.0], 1000) + 0.01 * np.sin(T), False),  # three set points
        (np.where(T < 15, np.sin(T), 8.0 + np.sin(T)), False),
        (np.ones(3000), False),
        (np.full(3000, np.nan), False),
    ],
)
def test_a_curve_is_drawn_over_what_was_visited_without_gaps(values, expected):
    assert _filled(values) is expected


def test_a_curve_may_turn_with_a_speed_over_which_none_is_drawn(monkeypatch):
    """Between set points of the speed a curve over it says anything, but its sign still turns one over position."""
    speed = np.repeat([-1.0, 1.0, -3.0], 1000)
    moving = {"position": np.sin(T), "velocity": speed}
    monkeypatch.setattr(library, "_moving", lambda base: moving)
    monkeypatch.setattr(library, "_slow", lambda base, share: {"velocity": 0.1})
    located = SimpleNamespace(site="force.external", signal=np.sign(speed) * np.sin(T))
    (best, *_) = curves(None, located)
    assert "velocity" in best.name and "position" in best.name
