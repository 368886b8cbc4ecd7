"""Every effect at its null is no effect, and has finite, bounded and true slopes there and elsewhere."""

from functools import cache

import casadi as ca
import numpy as np
import pytest

from tests.effects.plants import MACHINES, grown
from tests.effects.test_catalogue import OF_OTHERS

# Those that any site can carry at one site of each plant: of a command, of a sensor.
PLACES = ("@drive.command", "@sensor.level")
MET = ("rotary-axis", "servo-hydraulic")  # what others have is held to their sites there; here their own
EVERY = [
    (name, effect.name)
    for name in MACHINES
    for effect in grown(name).effects
    if (name in MET and effect.name in OF_OTHERS)
    or (name not in MET and ("@" not in effect.name or effect.name.endswith(PLACES)))
]
STIFFEST = 1e4  # 1/s


def randomised(plant, rng):
    """Parameters with effects at null but for their shapes, which are anywhere within their bounds."""
    own = {}
    for effect in plant.effects:
        for q in effect.parameters:
            if q.name not in effect.strength:
                low, high = np.clip(q.bounds, -10 * q.typical, 10 * q.typical)
                own[f"{effect.name}.{q.name}"] = rng.uniform(low, high)
    return plant.vector(own)


@pytest.mark.parametrize("name", MACHINES)
def test_at_their_null_all_effects_together_change_nothing(name):
    plant, rng = grown(name), np.random.default_rng(1)
    mine, own = plant.shared
    for x, u in zip(plant.states(rng, 200), plant.inputs(rng, 200), strict=True):
        p, q = plant.plain.vector(plant.values), randomised(plant, rng)
        plain = np.array(plant.plain.rates(x[mine], u[own], p)).ravel()
        full = np.array(plant.model.rates(x, u, q)).ravel()
        assert full[mine] == pytest.approx(plain, rel=1e-10, abs=1e-9)
        shown, shown_full = plant.plain.sensors(x[mine], u[own], p), plant.model.sensors(x, u, q)
        assert np.array(shown_full).ravel() == pytest.approx(np.array(shown).ravel(), rel=1e-12, abs=1e-13)
        assert np.isfinite(full).all()


@pytest.mark.parametrize(("name", "effect"), EVERY)
def test_an_effect_does_something_at_each_of_its_usual_points(name, effect):
    plant, rng = grown(name, effect), np.random.default_rng(2)
    (own,) = plant.effects
    null = plant.vector(own.qualified(own.at_null()))
    X, U = plant.states(rng, 300), plant.inputs(rng, 300)
    for point in own.usual:
        p = plant.vector(own.qualified(point))
        assert any(
            np.any(np.array(f(x, u, p)) != np.array(f(x, u, null)))
            for f in (plant.model.rates, plant.model.sensors)
            for x, u in zip(X, U, strict=True)
        ), point


def corners(plant, rng):
    """States and inputs where laws have their kinks: rest, ends of the stroke, zero command, equal pressures."""
    X, U = plant.states(rng, 40), plant.inputs(rng, 40)
    names = [state.name for state in plant.model.states]
    for k, x in enumerate(X):
        for name in names:
            i = names.index(name)
            if name in ("velocity", "bristle") and k % 2 == 0:
                x[i] = 0.0
            if name == "position" and k % 5 == 0:
                x[i] = rng.choice([-0.13, 0.0, 0.13])
            if name == "pressure_b" and k % 3 == 0:
                x[i] = rng.choice([x[names.index("pressure_a")], 1e5, 7e5])
            if "." in name and k % 2 == 0:
                x[i] = 293.0 if plant.model.states[i].unit == "K" else 0.0
        if k % 4 == 0:
            U[k][plant.shared[1]] = 0.0
    return X, U


@cache
def jacobian(plant):
    """(x, u, p) -> d(rates, sensors)/d(x, p)."""
    m = plant.model
    x, u, p = (
        ca.SX.sym(c, n) for c, n in (("x", len(m.states)), ("u", len(m.inputs)), ("p", len(m.parameters)))
    )
    both = ca.vertcat(m.rates(x, u, p), m.sensors(x, u, p))
    return ca.Function("J", [x, u, p], [both, ca.densify(ca.jacobian(both, ca.vertcat(x, p)))])


@pytest.mark.parametrize(("name", "effect"), EVERY)
def test_slopes_are_finite_where_laws_have_their_kinks(name, effect):
    plant, rng = grown(name, effect), np.random.default_rng(3)
    (own,) = plant.effects
    slopes = jacobian(plant)
    X, U = corners(plant, rng)
    for point in (own.at_null(), *own.usual):
        p = plant.vector(own.qualified(point))
        for x, u in zip(X, U, strict=True):
            values, J = slopes(x, u, p)
            assert np.isfinite(np.array(values)).all(), (point, x, u)
            assert np.isfinite(np.array(J)).all(), (point, x, u)


@pytest.mark.parametrize(("name", "effect"), EVERY)
def test_slopes_to_the_parameters_are_those_of_finite_differences(name, effect):
    plant, rng = grown(name, effect), np.random.default_rng(4)
    (own,) = plant.effects
    slopes, n = jacobian(plant), len(plant.model.states)
    compared = 0
    for x, u in zip(plant.states(rng, 8), plant.inputs(rng, 8), strict=True):
        for point in own.usual:
            p = plant.vector(own.qualified(point))
            J = np.array(slopes(x, u, p)[1])
            for q in own.fitted:
                i, h = plant.model.index(f"{own.name}.{q.name}"), 1e-6 * q.typical
                ends = [
                    np.array(slopes(x, u, np.r_[p[:i], p[i] + s * h, p[i + 1 :]])[0]).ravel() for s in (1, -1)
                ]
                inexact = (ends[0] - ends[1]) / (2 * h)
                rounding = 1e-9 * np.abs(ends[0]).max() / q.typical
                assert J[:, n + i] == pytest.approx(
                    inexact, rel=2e-4, abs=2e-4 * np.abs(inexact).max() + rounding
                ), (q.name, point)
                compared += int(np.abs(inexact).max() > 0)
    assert compared


@pytest.mark.parametrize(("name", "effect"), EVERY)
def test_no_admissible_value_makes_the_plant_stiff(name, effect):
    """Relaxation that the effect adds: eigenvalues beyond those of the plain plant at the same point."""
    plant, rng = grown(name, effect), np.random.default_rng(5)
    (own,) = plant.effects
    slopes, n, mine = jacobian(plant), len(plant.model.states), plant.shared[0]
    null = plant.vector(own.qualified(own.at_null()))
    for x, u in zip(plant.states(rng, 60), plant.inputs(rng, 60), strict=True):
        values = {
            q.name: rng.choice([*np.clip(q.bounds, -100 * q.typical, 100 * q.typical), q.typical])
            for q in own.parameters
        }
        p = plant.vector(own.qualified(values))
        J, J0 = (np.array(slopes(x, u, c)[1])[:n, :n] for c in (p, null))
        fastest = np.abs(np.linalg.eigvals(J)).max()
        plain = np.abs(np.linalg.eigvals(J0[np.ix_(mine, mine)])).max()
        assert fastest < max(STIFFEST, 1.5 * plain), values
