"""Dry friction with presliding: how it yields, and what of it is left when it slides."""

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from optid.core.sheet import build
from optid.rigs.friction import sliding
from optid.rigs.rotary_axis import rotary_axis
from optid.rigs.servo_hydraulic import servo_hydraulic
from optid.rigs.servo_pneumatic import servo_pneumatic

LENGTH = 1e-5


def contact(s):
    """A contact drawn at a recorded speed."""
    s.output("friction", "1", sliding(s, s.input("v", "m/s"), "bristle"))


def yielded(shape, distance, speed=1e-4):
    """Share of full friction after a slow draw over a distance from rest."""
    model = build(contact)
    p = model.vector(
        {"presliding_length": LENGTH, "presliding_shape": shape, "bristle_lag": 1e-7, "bristle_damping": 0}
    )
    run = solve_ivp(
        lambda t, z: np.array(model.rates(z, speed, p)).ravel(),
        (0, distance / speed),
        [0.0],
        rtol=1e-9,
        atol=1e-12,
    )
    return run.y[0, -1]


@pytest.mark.parametrize("share", [0.25, 1.0, 3.0])
def test_shape_0_is_dahls_law(share):
    assert yielded(0.0, share * LENGTH) == pytest.approx(1 - np.exp(-share), rel=1e-3)


def test_shape_1_holds_until_it_slides():
    assert yielded(1.0, 0.5 * LENGTH) == pytest.approx(0.5, rel=0.02)
    assert yielded(1.0, 0.9 * LENGTH) > 0.8
    assert yielded(0.0, 0.9 * LENGTH) < 0.6
    assert yielded(1.0, 2.5 * LENGTH) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("shape", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("speed", [-0.5, 0.5])
def test_sliding_is_full_friction_against_the_motion(shape, speed):
    model = build(contact)
    p = model.vector({"presliding_shape": shape})
    z = np.sign(speed)
    assert float(model.rates([z], [speed], p)) == pytest.approx(0.0, abs=1e-9)
    assert float(model.sensors([z], [speed], p)) == pytest.approx(z)
    slope = ca.Function(
        "f", model.rates.sx_in(), [ca.jacobian(model.rates(*model.rates.sx_in()), model.rates.sx_in(0))]
    )
    assert float(slope([z], [speed], p)) < 0  # it comes back to it


def test_damping_of_the_contact_fades_with_speed():
    """Half of it is left at `bristle_fading`, a fifth at twice that speed."""
    model = build(contact)
    values = {
        "presliding_length": LENGTH,
        "bristle_lag": 1e-7,
        "bristle_damping": 3e-4,
        "bristle_fading": 0.02,
    }
    p = model.vector(values)

    def damping(speed):
        z = [0.3]
        return float((model.sensors(z, [speed], p) - z) / model.rates(z, [speed], p))

    assert damping(1e-6) == pytest.approx(3e-4, rel=1e-6)
    assert damping(0.02) == pytest.approx(1.5e-4, rel=1e-6)
    assert damping(-0.04) == pytest.approx(0.6e-4, rel=1e-6)


@pytest.mark.parametrize(
    ("plant", "biased"),
    [
        (servo_pneumatic, {"viscous_friction"}),
        (rotary_axis, {"load_inertia", "payload_mass", "viscous_friction", "coulomb_friction"}),
        (servo_hydraulic, {"bulk_modulus", "viscous_friction", "coulomb_friction"}),
    ],
)
def test_what_true_stiction_leaves_is_stated_for_an_elastic_contact_alone(plant, biased):
    model = build(plant)
    assert set(model.biases) == biased
    assert biased <= {q.name for q in model.parameters}
    assert all(0.0 < share < 2e-3 for share in model.biases.values())
    assert build(plant, friction="smooth").biases == {}
