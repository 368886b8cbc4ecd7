"""The electro-mechanical axis: its equation at points computed by hand, and its options."""

import casadi as ca
import numpy as np
import pytest

from optid.core.sheet import build
from optid.errors import PlantError
from optid.rigs.emps import emps

VALUES = {
    "mass": 100.0,
    "drive_gain": 35.0,
    "viscous_friction": 200.0,
    "coulomb_friction": 20.0,
    "force_offset": -3.0,
}
SEPARATE = {
    **VALUES,
    "viscous_friction_negative": 240.0,
    "coulomb_friction_negative": 25.0,
    "force_offset": 0.0,
}


def rates(model, state, command, values):
    return np.array(model.rates(state, [command], model.vector(values))).ravel()


def test_forces_at_speed_add_up_to_the_published_equation():
    model = build(emps, friction="smooth")
    # 0.1 m/s is 33 friction widths: 35 * 2 - 200 * 0.1 - 20 + 3 = 33 N on 100 kg.
    assert rates(model, [0.0, 0.1], 2.0, VALUES) == pytest.approx([0.1, 0.33], rel=1e-12)
    # Backwards: -70 + 20 + 20 + 3 = -27 N.
    assert rates(model, [0.05, -0.1], -2.0, VALUES) == pytest.approx([-0.1, -0.27], rel=1e-12)


def test_bristle_carries_a_command_below_break_away_at_rest():
    model = build(emps)
    # 35 * 0.4 + 3 = 17 N are held by a bristle at 17/20 of its slip length.
    assert rates(model, [0.0, 0.0, 0.85], 0.4, VALUES) == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)


def test_fully_deflected_bristle_is_coulomb_friction():
    model = build(emps)
    assert rates(model, [0.0, 0.1, 1.0], 2.0, VALUES) == pytest.approx([0.1, 0.33, 0.0], rel=1e-12)


@pytest.mark.parametrize(
    ("speed", "command", "acceleration"), [(0.1, 2.0, 0.30), (-0.1, -2.0, (-70 + 24 + 25) / 100)]
)
def test_separate_directions_take_their_own_friction(speed, command, acceleration):
    model = build(emps, friction="smooth", direction="separate")
    assert rates(model, [0.0, speed], command, SEPARATE)[1] == pytest.approx(acceleration, rel=1e-12)


@pytest.mark.parametrize("friction", ["bristle", "smooth"])
def test_equal_separate_friction_is_symmetric_friction(friction):
    symmetric, separate = (build(emps, friction=friction, direction=d) for d in ("symmetric", "separate"))
    same = {**VALUES, "viscous_friction_negative": 200.0, "coulomb_friction_negative": 20.0}
    for speed in (-0.2, -1e-3, 0.0, 2e-3, 0.3):
        state = [0.0, speed, 0.4][: len(symmetric.states)]
        assert rates(separate, state, 1.0, same) == pytest.approx(
            rates(symmetric, state, 1.0, VALUES), rel=1e-13
        )


def test_parameters_of_the_other_direction_are_declared_only_when_chosen():
    assert "coulomb_friction_negative" not in {q.name for q in build(emps).parameters}
    assert "coulomb_friction_negative" in {q.name for q in build(emps, direction="separate").parameters}


def test_roles_and_sites():
    model = build(emps)
    assert [(port.role, port.unit) for port in model.inputs + model.outputs] == [
        ("command", "V"),
        ("position", "m"),
    ]
    assert {"drive.command", "force.coulomb", "force.viscous", "force.friction", "force.external"} <= set(
        model.sites
    )


def test_slopes_stay_finite_at_rest():
    model = build(emps)
    x, u, p = (ca.SX.sym(n, k) for n, k in (("x", 3), ("u", 1), ("p", len(model.parameters))))
    slope = ca.Function("slope", [x, u, p], [ca.jacobian(model.rates(x, u, p), ca.vertcat(x, p))])
    assert np.all(np.isfinite(np.array(slope([0, 0, 0], [0], model.vector(VALUES)))))


def test_an_unknown_choice_is_refused():
    with pytest.raises(PlantError, match="'symmetric' or 'separate'"):
        build(emps, direction="both")
