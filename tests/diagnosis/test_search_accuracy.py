"""The search integrates less accurately than its result is fitted and tested."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from optid.core.readers import read_recording
from optid.diagnosis.base_fit import fit_base
from optid.diagnosis.criteria import SearchOptions
from optid.diagnosis.fitted import refit
from optid.diagnosis.problem import DiagnosisProblem, measurement_noise, prepare
from optid.diagnosis.refinement import final_fit
from optid.estimation.problem import TOLERANCE
from optid.rigs.friction import PRESLIDING_LENGTH
from optid.rigs.rigfile import read_rig
from tests.diagnosis.trolley import problem_of, recording

DATA = Path(__file__).parents[2] / "data"


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


def test_the_final_fit_goes_below_the_bounds_that_keep_a_search_quick():
    rig = read_rig(DATA / "bench.toml")
    rig, train = prepare(rig, [read_recording(DATA / "bench.csv", rig)])
    noise = measurement_noise(rig, train)
    asked = DiagnosisProblem(rig, train, noise, options=SearchOptions(turns=1, steps=1))
    base, search = fit_base(asked.at_search_accuracy())

    def lowest(model):
        q = model.likelihood_problem
        return q.low[[q.model.parameters[i].name for i in q.free].index("presliding_length")]

    final = final_fit(base, search, asked)
    assert lowest(base) == PRESLIDING_LENGTH.nuisance.low
    assert lowest(final) == PRESLIDING_LENGTH.bounds[0] < lowest(base)
    assert final.fit.loss <= refit(base, asked).fit.loss
    unattained = replace(search, criteria=replace(search.criteria, error_over_noise=0.0))
    assert final_fit(base, unattained, asked) is refit(base, asked)
