"""Which forms are worth a fit: a curve over what was visited without gaps, and a look at all that is short."""

from types import SimpleNamespace

import numpy as np
import pytest

from optid.diagnosis.proposals import SHORT, worst_recordings
from optid.diagnosis.surrogate.library import _filled

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


def test_short_recordings_are_all_looked_at():
    """Friction that differs from recording to recording shows in no single one."""
    problem = SimpleNamespace(time=np.zeros(SHORT), counts=np.array([10, 20, 30]))
    current = SimpleNamespace(likelihood_problem=SimpleNamespace(problem=problem))
    assert worst_recordings(current, None) == [0, 1, 2]
