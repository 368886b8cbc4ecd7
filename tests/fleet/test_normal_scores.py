"""Normal scores: tails as heavy as the nights', bounded, and sums whose p-values hold."""

import numpy as np
import pytest
from scipy import stats

from optid.fleet.statistics.normal_scores import CAP, LOOKS, looks, normal_scores, smallest_p, tail_degrees


def test_tails_are_as_heavy_as_the_nights_show():
    rng = np.random.default_rng(1)
    assert 2.0 < tail_degrees(stats.t.rvs(3.0, size=2000, random_state=rng) ** 2, 1) <= 3.2
    assert tail_degrees(rng.normal(size=2000) ** 2, 1) > 20.0
    assert tail_degrees(rng.normal(size=20) ** 2, 1) < 20.0  # of few nights no light tail is sure


@pytest.mark.parametrize("width", [1, 5])
def test_heavy_tails_become_normal_ones(width):
    rng = np.random.default_rng(2)
    scale = np.sqrt(3.0 / stats.chi2.rvs(3.0, size=4000, random_state=rng))[:, None]
    scores = normal_scores(scale * rng.normal(size=(4000, width)), 3.0)
    assert stats.kstest(np.sum(scores**2, axis=1), stats.chi2(width).cdf).pvalue > 1e-3


def test_no_night_counts_without_end():
    assert normal_scores(np.array([[1e9], [-1e9]]), 5.0) == pytest.approx(np.array([[CAP], [-CAP]]))
    one = np.array([[0.3], [0.1], [1e9], [-0.2], [0.4]])
    assert smallest_p(looks(normal_scores(one, 5.0), 7)[1])[1:].min() > 1e-2


def test_p_values_of_sums_hold_though_nights_share_their_reference():
    rng = np.random.default_rng(3)
    shared = rng.normal(size=(3000, 1)) / np.sqrt(8.0)
    nights = shared + np.sqrt(7.0 / 8.0) * rng.normal(size=(3000, LOOKS[-1]))
    last = np.array([looks(one[:, None], 7)[1][-1] for one in nights])
    for p in last.T:
        assert stats.kstest(p, "uniform").pvalue > 1e-3
