"""Properties that hold for any input, found by search."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from optid.armax import Constant, Directional, Identifier, Method, Orders, Settings, Variable, identify
from optid.armax import layout as at

LAWS = st.sampled_from([Constant(1.0), Constant(0.9), Variable(50.0, 0.8), Directional(0.9)])
ORDERS = st.sampled_from(
    [Orders(2, (2,), 2, (1,)), Orders(1, (2, 1), 1, (0, 3)), Orders(2, nc=3), Orders(3, (1,), 0, (1,))]
)
METHODS = st.sampled_from(list(Method))
ANY = st.floats(allow_nan=True, allow_infinity=True)
USUAL = st.floats(-1e3, 1e3)


@st.composite
def cases(draw, values=ANY, length=60):
    orders = draw(ORDERS)
    chosen = Settings(
        method=draw(METHODS),
        forgetting=draw(LAWS),
        outliers=draw(st.sampled_from([None, 3.0])),
        at_rest=draw(st.booleans()),
    )
    data = draw(arrays(float, (length, 1 + orders.inputs), elements=values))
    return orders, chosen, data[:, 0].copy(), data[:, 1:].copy()


@settings(max_examples=300, deadline=None)
@given(cases())
def test_covariance_stays_positive_for_any_input(case):
    orders, chosen, y, u = case
    identifier = Identifier(orders, settings=chosen)
    identifier.run(np.tile(y, 4), np.tile(u, (4, 1)))
    n, state = orders.parameters, identifier.state
    assert np.all(np.isfinite(identifier.theta))
    D = state[at.diagonal_at(orders) : at.diagonal_at(orders) + n]
    U = state[at.triangle_at(orders) : at.places(orders)[at.OUTPUTS]]
    assert np.all(D > 0) and np.all(np.isfinite(D))
    assert np.all(np.isfinite(U))
    assert np.all(np.diag(identifier.scaled_covariance) > 0)


@settings(max_examples=100, deadline=None)
@given(cases(values=st.one_of(USUAL, st.just(float("nan")))), st.integers(0, 60))
def test_saving_and_restoring_changes_nothing(case, cut):
    orders, chosen, y, u = case
    whole, first = Identifier(orders, settings=chosen), Identifier(orders, settings=chosen)
    innovations, _ = whole.run(y, u)
    before, _ = first.run(y[:cut], u[:cut])
    second = Identifier(orders, settings=chosen).restored(first.state.tolist())
    after, _ = second.run(y[cut:], u[cut:])
    assert np.array_equal(np.concatenate([before, after]), innovations, equal_nan=True)
    assert np.array_equal(second.state, whole.state, equal_nan=True)


@settings(max_examples=60, deadline=None)
@given(st.integers(-30, 30), st.integers(-30, 30), st.integers(0, 10), LAWS)
def test_units_scale_through(py, pu, seed, law):
    """Measured in other units the same signals give the same model in those units."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal(400)
    y = np.convolve(u, [0.0, 1.0, 0.5, 0.2])[:400] + 0.1 * rng.standard_normal(400)
    orders = Orders(2, (2,), 1, (1,))
    chosen = Settings(forgetting=law)
    sy, su = 2.0**py, 2.0**pu
    here, there = (identify(a, b, orders, settings=chosen).model for a, b in ((y, u), (sy * y, su * u)))
    assert there.a == pytest.approx(here.a, rel=1e-12)
    assert there.c == pytest.approx(here.c, rel=1e-12)
    assert np.array(there.b[0]) * su / sy == pytest.approx(np.array(here.b[0]), rel=1e-12)
    assert there.noise_variance / sy**2 == pytest.approx(here.noise_variance, rel=1e-12)


@pytest.mark.parametrize("factor", [1e-3, 39.37, 1e5])
def test_units_that_are_no_powers_of_two(factor):
    rng = np.random.default_rng(1)
    u = rng.standard_normal(2000)
    y = np.convolve(u, [0.0, 1.0, 0.5, 0.2])[:2000] + 0.1 * rng.standard_normal(2000)
    orders = Orders(2, (2,), 1, (1,))
    here, there = (identify(a, u, orders).model for a in (y, factor * y))
    assert there.a == pytest.approx(here.a, rel=1e-9)
    assert np.array(there.b[0]) / factor == pytest.approx(np.array(here.b[0]), rel=1e-9)


def test_the_track_holds_the_parameters_after_every_so_many_samples():
    rng = np.random.default_rng(7)
    y, u = rng.standard_normal(40), rng.standard_normal((40, 1))
    orders = Orders(2, (2,), 1, (1,))
    _, track = Identifier(orders).run(y, u, every=10)
    assert track.shape == (4, orders.parameters)
    for row, samples in zip(track, (10, 20, 30, 40), strict=True):
        alone = Identifier(orders)
        alone.run(y[:samples], u[:samples])
        assert np.array_equal(row, alone.theta)
