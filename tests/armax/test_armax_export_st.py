"""Structured text computes what Python computes."""

from __future__ import annotations

import numpy as np
import pytest
from st_to_python import compiled

from optid.armax import Armax, Directional, Identifier, Method, Settings
from optid.armax.export_st import identifier_block, model_block
from optid.armax.prediction import innovations
from optid.errors import InputError


@pytest.mark.parametrize(
    "settings",
    [Settings(), Settings(method=Method.EXTENDED_LEAST_SQUARES, forgetting=Directional(0.99), outliers=4.0)],
    ids=["maximum likelihood", "directional"],
)
def test_identifier_is_python_s(settings, simulated):
    system = Armax(a=(1.0, -0.9), b=((1.0, 0.5), (-2.0,)), c=(1.0, 0.4), nk=(1, 2), noise_variance=0.01)
    y, u = simulated(system, 160, 5, switch=0.3)
    y[60], u[80, 1] = np.nan, np.nan
    identifier = Identifier(system.orders, settings=settings, scales=(2.0, [0.5, 0.3]))
    identifier.run(y[:20], u[:20])
    block = compiled(identifier_block(identifier, "rig"))["rig"]()
    expected, _ = identifier.run(y[20:], u[20:])
    found = []
    for now, inputs in zip(y[20:].tolist(), u[20:].tolist(), strict=True):
        block.call(now, inputs)
        found.append(block.innovation)
    assert found == pytest.approx(expected, rel=1e-12, abs=1e-12, nan_ok=True)
    assert block.theta == pytest.approx(identifier.theta, rel=1e-12, abs=1e-12)
    assert block.memory == pytest.approx(identifier.state, rel=1e-12, abs=1e-12, nan_ok=True)


def test_the_constant_is_nobody_s_to_give(simulated):
    system = Armax(a=(1.0, -0.9), b=((1.0,), (0.7,)), c=(1.0, 0.4), nk=(1, 0), noise_variance=0.01)
    y, u = simulated(system, 60, 1)
    u[:, 1] = 1.0
    identifier = Identifier(system.orders)
    block = compiled(identifier_block(identifier, "rig", constant=True))["rig"]()
    for now, inputs in zip(y.tolist(), u.tolist(), strict=True):
        block.call(now, inputs[:1])
    identifier.run(y, u)
    assert block.theta == pytest.approx(identifier.theta, rel=1e-12, abs=1e-12)


def test_model_is_python_s(truth, simulated):
    model = Armax(truth.a, truth.b, truth.c, truth.nk, 0.01, 0.01, constant=0.3)
    y, u = simulated(model, 400, 0)
    block = compiled(model_block(model, "plant"))["plant"]()
    found = []
    for now, past in zip(y.tolist(), u.tolist(), strict=True):
        block.call(now, past)
        found.append(block.innovation)
    assert found[200:] == pytest.approx(innovations(model, y, u)[200:], rel=1e-11, abs=1e-11)


def test_a_name_that_is_none_is_refused(truth):
    with pytest.raises(InputError, match="structured text"):
        model_block(truth, "two__lines")
