"""Fits by multi-step prediction errors against the closed form of a cart, and what a quiet filter is for."""

from dataclasses import replace

import numpy as np
import pytest

from optid.errors import SolveError
from optid.estimation import multistep
from optid.estimation.fixed_gain import FixedGainFit
from optid.estimation.multistep import (
    QUIET,
    MultistepFit,
    fit_multistep,
    multistep_at,
    multistep_loss,
    quiet_filter,
    window_starts,
)
from tests.estimation.cart import TRUTH, question

SECONDS = 0.5


@pytest.fixture(scope="module")
def asked(tmp_path_factory):
    return question(tmp_path_factory.mktemp("cart"))


def values(q, p):
    return {one.name: value for one, value in zip(q.model.parameters, p, strict=True) if one.name in TRUTH}


def test_it_finds_the_truth_from_a_start_far_off(asked):
    q, p = asked
    found = fit_multistep(q, p, SECONDS, turns=4, steps=6)
    assert values(q, found.p) == pytest.approx({n: TRUTH[n] for n in values(q, p)}, rel=0.02)
    assert found.loss < 0.1 * multistep_loss(q, p, SECONDS)


def test_it_goes_on_beyond_its_turns_while_the_loss_falls_fast(asked):
    """Short steps are far from the optimum after the one turn that was asked for."""
    q, p = asked
    found, best = (fit_multistep(q, p, SECONDS, turns=n, steps=k) for n, k in ((1, 1), (8, 6)))
    assert found.loss < 1.3 * best.loss


def test_its_loss_is_that_of_the_parameters_it_gives(asked):
    q, p = asked
    found = fit_multistep(q, p, SECONDS, turns=2, steps=4)
    there = multistep_at(q, found.p, SECONDS, found.level)
    assert there.loss == found.loss
    assert np.array_equal(there.filtered.gains, found.filtered.gains)
    assert found.level <= QUIET


def test_windows_that_must_err_count_less(asked):
    q, p = asked
    whole = multistep_loss(q, p, SECONDS)
    excused = replace(q, open_variance=np.full(q.problem.measured.shape, 8.0 * q.measurement[0]))
    # Squares of errors within Huber's range fall to a ninth; those beyond count linearly, and fall to a third at least.
    assert multistep_loss(excused, p, SECONDS) < whole / 3.0


def test_windows_begin_every_so_often_after_the_first_which_knows_nothing(asked):
    q, _ = asked
    starts = window_starts(q.problem, SECONDS)
    begin, count = int(q.problem.begins[0]), int(q.problem.counts[0])
    time = q.problem.time[begin : begin + count + 1]
    first = time - time[0] < SECONDS - 1e-9
    own = starts[begin : begin + count + 1]
    assert own[first].all()
    assert own[~first].sum() == int((time[-1] - time[0]) / SECONDS + 1e-9)


def test_a_quieter_filter_follows_the_data_less(asked):
    q, p = asked
    loud, quiet = (quiet_filter(q, p, level=level) for level in (0.0, -4.0))
    assert np.abs(quiet.gains[0, -1]).max() < np.abs(loud.gains[0, -1]).max()


def test_a_start_without_numbers_is_refused(asked):
    q, p = asked
    with pytest.raises(SolveError, match="diverged"):
        fit_multistep(q, np.full_like(p, np.nan), SECONDS, turns=1, steps=1)


def test_a_fit_that_was_begun_goes_on_where_it_was(asked):
    """The start that comes along is not looked at: here it cannot even be simulated."""
    q, p = asked
    begun = fit_multistep(q, p, SECONDS, turns=1, steps=1, most=1)
    found = fit_multistep(q, np.full_like(p, np.nan), SECONDS, turns=4, steps=6, begun=begun)
    assert found.loss < begun.loss
    assert values(q, found.p) == pytest.approx({n: TRUTH[n] for n in values(q, p)}, rel=0.02)


def test_a_level_that_predicts_no_better_is_tried_once(asked, monkeypatch):
    """Each level costs a filter, and the filter is the dearest part."""
    q, p = asked
    tried = []

    def stands(q, p, starts, level=QUIET):
        tried.append(level)
        loss = 1.0 / len(tried) if level >= QUIET else 1e9
        return MultistepFit(q, p, None, loss, level)

    monkeypatch.setattr(multistep, "_fit_at", stands)
    monkeypatch.setattr(multistep, "fixed_gain_fit", lambda q, p, *rest: FixedGainFit(p, 0.0))
    fit_multistep(q, p, SECONDS, turns=3, steps=1, most=3)
    assert tried == [QUIET, QUIET, QUIET + multistep.STEP, QUIET, QUIET]
