"""Smooth forms: a power with a finite slope at nothing."""

import casadi as ca
import numpy as np
import pytest

from optid.core.smooth import soft_power


@pytest.mark.parametrize("exponent", [0.5, 1.0, 2.0])
def test_a_soft_power_is_the_power_with_its_sign_and_smooth_at_nothing(exponent):
    q = np.array([-3.0, -0.4, 0.5, 2.0])
    assert soft_power(ca.DM(q), exponent, 1e-3).full().ravel() == pytest.approx(
        np.sign(q) * np.abs(q) ** exponent, rel=1e-5
    )
    x = ca.SX.sym("x")
    slope = ca.Function("slope", [x], [ca.gradient(soft_power(x, exponent, 1e-3), x)])
    assert float(slope(0.0)) == pytest.approx(1e-3 ** (exponent - 1))
