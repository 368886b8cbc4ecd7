"""Separations from inner products are those of least squares on the columns themselves."""

import numpy as np
import pytest

from optid.experiments.design import choose, worth
from optid.experiments.separation import pairs, separations
from optid.experiments.signatures import Layout

LAYOUT = Layout(3, ((3, 4), (6,)), ((3, 4, 5), (6, 7)))


@pytest.fixture
def columns():
    """Slopes of very different sizes, and the forms of two rivals that share some of them."""
    rng = np.random.default_rng(8)
    C = rng.standard_normal((400, 8))
    C[:, :3] *= (1e4, 1.0, 1e-3)
    C[:, 3] += 1e-3 * C[:, 0] + C[:, 6]
    C[:, 5] += 5.0 * C[:, 3]
    return C


def left_over(column, basis):
    """Length of what least squares leave."""
    scaled = basis / np.linalg.norm(basis, axis=0)
    return np.linalg.norm(column - scaled @ np.linalg.lstsq(scaled, column, rcond=None)[0])


def test_separations_are_those_of_least_squares(columns):
    found = separations(columns.T @ columns, LAYOUT, pairs(2))
    slopes, one, two = columns[:, :3], columns[:, 3:6], columns[:, 6:]
    expected = [
        min(left_over(columns[:, k], np.c_[slopes, two]) for k in (3, 4)),
        left_over(columns[:, 6], np.c_[slopes, one]),
    ]
    assert found == pytest.approx(expected, rel=1e-6)


def test_an_effect_alone_is_its_length_after_the_parameters(columns):
    [found] = separations(columns.T @ columns, LAYOUT, ((0, None),))
    assert found == pytest.approx(min(left_over(columns[:, k], columns[:, :3]) for k in (3, 4)), rel=1e-6)


def test_products_of_pieces_add_to_those_of_the_whole(columns):
    parts = np.array([part.T @ part for part in np.split(columns, 4)])
    whole = separations(columns.T @ columns, LAYOUT, pairs(2))
    assert separations(parts.sum(axis=0), LAYOUT, pairs(2)) == pytest.approx(whole, rel=1e-9)


def test_what_the_other_imitates_is_not_separated(columns):
    columns[:, 6] = 2.0 * columns[:, 4] + 1e-4 * columns[:, 0]
    there, _ = separations(columns.T @ columns, LAYOUT, ((1, 0), (0, 1)))
    assert there == 0.0


def test_what_a_rig_does_not_see_is_not_separated(columns):
    columns[:, 6:] = 0.0
    found = separations(columns.T @ columns, LAYOUT, pairs(2))
    assert found[0] > 1.0
    assert found[1] == 0.0


def test_without_free_parameters():
    C = np.random.default_rng(1).standard_normal((50, 2))
    layout = Layout(0, ((0,), (1,)), ((0,), (1,)))
    assert separations(C.T @ C, layout, ((0, 1),)) == pytest.approx([left_over(C[:, 0], C[:, 1:])])


def test_the_choice_raises_the_least_and_repeats_nothing_thrice(columns):
    rng = np.random.default_rng(2)
    scales = rng.uniform(0.1, 2.0, (10, 1, 8))
    parts = np.array([(s * columns).T @ (s * columns) for s in scales])
    wanted = pairs(2)
    chosen = choose(parts, LAYOUT, wanted, 5)
    assert max(chosen.count(k) for k in chosen) <= 2
    assert chosen[0] == max(range(10), key=lambda k: worth(parts[k], LAYOUT, wanted))
    assert chosen[0] not in choose(parts, LAYOUT, wanted, 5, left_out=chosen[:1])
    assert len(choose(parts[:2], LAYOUT, wanted, 9)) == 9
