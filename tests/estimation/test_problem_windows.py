"""Recordings cut into windows: a rest too short for a window of its own joins the last one."""

import numpy as np
import pytest

from optid.estimation.problem import window_numbers


@pytest.mark.parametrize(
    ("duration", "lengths"),
    [(2.0, [0.5] * 4), (2.2, [0.5, 0.5, 0.5, 0.7]), (2.3, [0.5, 0.5, 0.5, 0.5, 0.3]), (0.3, [0.3])],
)
def test_a_rest_of_less_than_half_a_window_joins_the_last(duration, lengths):
    time = np.arange(round(duration * 1000) + 1) / 1000
    number = window_numbers(time, 0.5)
    assert np.bincount(number) == pytest.approx(1000 * np.array(lengths), abs=1.0)
