"""Process noise that makes fixed parameters likeliest, of a right model and of a wrong one."""

import numpy as np
import pytest

from optid.diagnosis.refinement import likely_noise
from optid.estimation.fisher_scoring import likelihood_problem
from optid.estimation.likelihood import WHOLE, run_filter
from optid.estimation.problem import build_problem
from tests.estimation.cart import TRUTH, recording, rig


@pytest.mark.parametrize(("factor", "least"), [(1.0, 0.95), (0.2, 0.5), (5.0, 0.5)])
def test_what_a_filter_misses_agrees_with_what_it_claims(tmp_path, factor, least):
    """Also where the model is wrong by far, and its sensor good: intervals rest on these variances."""
    cart = rig(tmp_path, gain=factor * TRUTH["gain"], drag=TRUTH["drag"])
    data = recording(np.random.default_rng(3), seconds=6.0, sd=1e-5)
    q = likelihood_problem(cart, build_problem(cart.model, [data], WHOLE), cart.model)
    q.measurement[:] = 1e-10
    p = q.model.vector(cart.parameters)
    noise = likely_noise(q, p)
    Q, R = noise.spectrum(len(q.model.states))[None], noise.measurement[None]
    f = run_filter(q.model, q.problem, p[None], Q, R)
    size = float(np.sqrt(np.nanmean(f.innovations[0] ** 2 / f.variances[0])))
    assert least < size < 1.5
