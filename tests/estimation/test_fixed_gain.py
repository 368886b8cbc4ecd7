"""Steps under fixed gains: slopes that are updated instead of simulated, and folds predicted from the others."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from optid.estimation import fixed_gain
from optid.estimation.fixed_gain import (
    Residuals,
    checked_broyden_update,
    cross_validated_residuals,
    fixed_gain_fit,
)
from optid.estimation.multistep import fit_multistep, quiet_filter, window_starts
from tests.estimation.cart import TRUTH, question

SECONDS = 0.5


@pytest.fixture(scope="module")
def asked(tmp_path_factory):
    return question(tmp_path_factory.mktemp("cart"))


def test_updated_slopes_reach_the_optimum_of_simulated_ones_with_fewer_simulations(asked, monkeypatch):
    q, p = asked
    held, resets = quiet_filter(q, p), window_starts(q.problem, SECONDS)
    sets, simulate = [], fixed_gain.innovations
    monkeypatch.setattr(
        fixed_gain,
        "innovations",
        lambda q, P, *rest, **named: sets.append(len(P)) or simulate(q, P, *rest, **named),
    )
    found, spent = [], []
    for share in (0.0, fixed_gain.MISSED):
        sets.clear()
        monkeypatch.setattr(fixed_gain, "MISSED", share)
        found.append(fixed_gain_fit(q, p, q.model, held, 8, resets))
        spent.append(sum(sets))
    assert found[1].loss == pytest.approx(found[0].loss, rel=2e-3)
    assert found[1].p == pytest.approx(found[0].p, rel=5e-3)
    assert spent[1] < spent[0]
    gain, drag = (q.model.index(name) for name in ("gain", "drag"))
    assert found[1].p[[gain, drag]] == pytest.approx([TRUTH["gain"], TRUTH["drag"]], rel=0.02)


def test_an_update_explains_the_step_and_leaves_other_directions_alone():
    J = np.array([[1.0, 0.0], [0.0, 2.0], [0.0, 0.0]])
    step, change = np.array([0.5, 0.0]), np.array([0.5, 0.05, 0.0])
    new = checked_broyden_update(J, step, change)
    assert new @ step == pytest.approx(change)
    assert np.array_equal(new[:, 1], J[:, 1])


def test_slopes_that_missed_most_of_a_step_are_simulated_again():
    assert checked_broyden_update(np.eye(2), np.array([1.0, 0.0]), np.array([0.0, 1.0])) is None


def test_a_fold_is_predicted_with_parameters_fitted_to_the_others(asked):
    """Against least squares of another library over the rows of the other folds."""
    q, p = asked
    fit = fit_multistep(q, p, SECONDS, turns=4, steps=6)
    residuals = Residuals(q, fit.p, q.model, fit.filtered, resets=window_starts(q.problem, SECONDS))
    (z,) = residuals.at(residuals.start[None])
    known = len(z) - len(residuals.start)
    fold = np.arange(known) * 6 // known % 3
    fold[: known // 12] = -1  # fitted, never predicted
    found, rows = cross_validated_residuals(residuals, fold), np.append(fold, [-1, -1])
    for number in range(3):
        there = least_squares(
            lambda x, n=number: residuals.at(x[None])[0][rows != n], residuals.start, x_scale=1e-3
        )
        expected = residuals.at(there.x[None])[0]
        here = rows == number
        moved = np.linalg.norm(expected[here] - z[here])
        assert moved > 0.0
        assert np.linalg.norm(found[fold == number] - expected[here]) < 0.1 * moved
    assert np.array_equal(found[fold < 0], z[:known][fold < 0])
