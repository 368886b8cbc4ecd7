"""Residual tests on a hold-out: correct models fail as often as stated, also with gaps; what is left is found."""

from types import SimpleNamespace

import numpy as np
import pytest

from optid.core.channel import Channel
from optid.core.recording import Recording
from optid.diagnosis.residual_tests import residual_tests

N, DRAWS, LEVEL = 2000, 300, 0.01
MODEL = SimpleNamespace(recorded=[SimpleNamespace(role="command")])


def checked(z, u, kept=slice(None)):
    """Tests of innovations that stand at some samples of a recording."""
    time = 0.01 * np.arange(N)
    recording = Recording("r.csv", time, {"command": Channel("command", "u", "V", u)})
    seen = SimpleNamespace(
        recording=np.zeros(len(z[kept]), dtype=int), innovations=z[kept][:, None], time=time[kept]
    )
    return residual_tests(seen, MODEL, [recording], LEVEL)


@pytest.mark.parametrize("every", [1, 4, 10])
def test_a_correct_model_fails_as_often_as_stated(every):
    """A sensor read at every so-many-th sample leaves the others empty."""
    rng, failed = np.random.default_rng(every), np.zeros(2)
    for _ in range(DRAWS):
        z, u = rng.standard_normal(N), np.repeat(rng.uniform(-1, 1, N // 50), 50)
        z[np.arange(N) % every > 0] = np.nan
        found = checked(z, u)
        failed += [not found.white, not found.independent]
    assert (failed <= DRAWS * LEVEL + 3.0 * np.sqrt(DRAWS * LEVEL)).all()


def test_a_response_that_is_left_is_found_where_the_first_samples_were_dropped():
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-1, 1, N // 20), 20)
    z = rng.standard_normal(N)
    z[3:] += 4.0 * np.diff(u, prepend=u[0])[:-3]
    found = checked(z, u, slice(137, None))
    assert not found.independent
    assert checked(rng.standard_normal(N), u, slice(137, None)).independent
