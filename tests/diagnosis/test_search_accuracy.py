"""The search integrates less accurately than its result is fitted and tested."""

from dataclasses import replace

import numpy as np

from optid.diagnosis.base_fit import fit_base
from optid.diagnosis.fitted import refit
from optid.estimation.problem import TOLERANCE
from tests.diagnosis.trolley import problem_of, recording


def tolerances(model):
    return model.fit.filtered.tolerance[0] / model.likelihood_problem.model.scales


def test_the_result_of_a_search_is_fitted_again_as_accurately_as_it_is_tested(tmp_path):
    asked = problem_of(tmp_path, [recording(1, "1.csv")])
    search = asked.at_search_accuracy()
    assert search.train is asked.train  # slow enough: not decimated
    base, _ = fit_base(search)
    assert np.allclose(tolerances(base), asked.options.tolerance)
    assert asked.options.tolerance > TOLERANCE
    again = refit(base, asked)
    assert np.allclose(tolerances(again), TOLERANCE)
    assert refit(again, asked) is again
    assert refit(base, asked) is again  # remembered: several stages ask


def test_a_faster_recording_is_also_decimated(tmp_path):
    asked = problem_of(tmp_path, [recording(1, "1.csv")])
    asked = replace(asked, options=replace(asked.options, rate=50.0))
    search = asked.at_search_accuracy()
    assert len(search.train[0]) < len(asked.train[0])
    assert search.likelihood_problem(search.rig).problem.tolerance == asked.options.tolerance
