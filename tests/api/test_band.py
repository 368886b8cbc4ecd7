"""The 95 % band of predictions, on a model whose answer is known."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from optid.api import band
from optid.core.parameter import Parameter

TIME = np.linspace(0.0, 1.0, 11)
COVARIANCE = np.array([[0.04, 0.01], [0.01, 0.09]])


def line(values):
    predicted = values["a"] * TIME + values["b"]
    return pd.DataFrame({"y": TIME, "y_free_run": predicted, "y_window": 0.0 * predicted})


@pytest.fixture
def rig():
    parameters = [Parameter(name, "1", 1.0, "", "", bounds=(0.0, 10.0)) for name in "ab"]
    return SimpleNamespace(path="rig.toml", model=SimpleNamespace(parameters=parameters))


def banded(monkeypatch, rig, values, predicted=line):
    monkeypatch.setattr(
        band, "predict", lambda rig, one, values, noise: SimpleNamespace(frame=predicted(values))
    )
    fit = SimpleNamespace(
        parameters=dict.fromkeys(values), values=values, covariance=COVARIANCE, process_noise=None
    )
    return band.with_band(line(values), rig, [None], fit, lambda share, words: None)


@pytest.mark.parametrize("values", [{"a": 2.0, "b": 1.0}, {"a": 0.0, "b": 10.0}], ids=["inside", "at bounds"])
def test_its_width_is_the_covariances(monkeypatch, rig, values):
    found = banded(monkeypatch, rig, values)
    slopes = np.stack([TIME, np.ones_like(TIME)])
    half = 1.959964 * np.sqrt(np.einsum("in,ij,jn->n", slopes, COVARIANCE, slopes))
    np.testing.assert_allclose(found["y_free_run_high"] - found["y_free_run"], half, rtol=1e-9)
    np.testing.assert_allclose(found["y_free_run"] - found["y_free_run_low"], half, rtol=1e-9)
    assert (found["y_window_low"] == 0.0).all()


def test_a_start_that_jumps_on_one_side_does_not_widen_it(monkeypatch, rig):
    values = {"a": 2.0, "b": 1.0}
    plain = banded(monkeypatch, rig, values)
    jumps = banded(monkeypatch, rig, values, lambda v: line(v) + (v["a"] > 2.0))
    pd.testing.assert_frame_equal(jumps, plain)


def test_a_fit_of_another_model_is_refused(monkeypatch, rig):
    with pytest.raises(band.InputError, match='"c"'):
        banded(monkeypatch, rig, {"a": 2.0, "b": 1.0, "c": 1.0})
