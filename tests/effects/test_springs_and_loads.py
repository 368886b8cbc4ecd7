"""A spring that hardens and friction that grows with the load, on a small plant of a user's own."""

import math

import numpy as np
import pytest

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet, build
from optid.core.simulation import simulate
from optid.effects.library import admitted, built_in, find_effect
from optid.rigs.friction import dry_friction

STIFFNESS = Parameter("stiffness", "N/m", 100.0, "of the spring", "test", 100.0, (0.0, math.inf))


def oscillator(s: Sheet) -> None:
    """One kilogram on a spring of 100 N/m, whose force is usually 20 N; dry friction under a drive."""
    x, v = s.state("position", "m", 0.1, start=0.2), s.state("velocity", "m/s", 1.0)
    spring = s.site("force.spring", s.param(STIFFNESS) * x, size=20.0)
    drive = s.site("drive.force", s.input("force", "N"), size=5.0)
    drag = dry_friction(s, v, "smooth", drive=drive)
    s.rate(x, v)
    s.rate(v, drive - spring - drag)
    s.output("position", "m", x)


def rates(effect, values, x, v, force):
    model = build(oscillator, [effect])
    p = model.vector({"stiffness": 100.0, "coulomb_friction": 2.0, "friction_width": 1e-3, **values})
    return float(np.array(model.rates([x, v], [force], p))[1, 0])


@pytest.mark.parametrize("hardening", [-0.2, 0.5])
@pytest.mark.parametrize("x", [-0.4, 0.1])
def test_a_hardening_spring_adds_the_cube_of_its_force(hardening, x):
    effect = find_effect("hardening_spring@force.spring", None)
    effect = next(e for e in admitted(build(oscillator)) if e.name == effect.name)
    values = {"hardening_spring@force.spring.hardening": hardening}
    cubic = 100.0 * x * (1 + hardening * (100.0 * x / 20.0) ** 2)
    assert rates(effect, values, x, 0.0, 0.0) == pytest.approx(-cubic, rel=1e-12)


def test_its_swing_at_a_large_amplitude_is_faster_as_duffing_has_it():
    """w^2 = k (1 + 3/4 h (A k / size)^2) to first order, Nayfeh and Mook, Nonlinear Oscillations, section 2.3."""
    effect = find_effect("hardening_spring@force.spring", None)
    effect = type(effect)("force.spring", 20.0)
    model = build(oscillator, [effect])
    name = "hardening_spring@force.spring.hardening"
    p = model.vector({"stiffness": 100.0, "coulomb_friction": 0.0, "friction_width": 1e-3, name: 0.1})
    dt = np.full(20000, 1e-3)
    run = simulate(model, p, np.array([0.2, 0.0]), dt, np.zeros((len(dt) + 1, 1)))
    x = run.outputs[0, :, 0]
    crossings = np.flatnonzero((x[:-1] > 0) & (x[1:] <= 0))
    frequency = 2 * np.pi * (len(crossings) - 1) / (1e-3 * (crossings[-1] - crossings[0]))
    assert frequency == pytest.approx(10.0 * math.sqrt(1 + 0.75 * 0.1), rel=2e-3)


def test_it_is_offered_at_springs_only():
    names = {effect.name for effect in admitted(build(oscillator))}
    assert "hardening_spring@force.spring" in names
    assert "power_law@drive.force" in names and "hardening_spring@drive.force" not in names


def test_friction_grows_with_what_is_driven_through_the_contact():
    effect = built_in()["load_dependent_friction"]
    values = {"load_dependent_friction.share": 0.25}
    for force in (-8.0, 8.0):
        assert rates(effect, values, 0.0, 0.5, force) == pytest.approx(force - (2.0 + 0.25 * 8.0), rel=1e-3)


def test_a_contact_without_a_drive_has_no_friction_of_it():
    def plain(s: Sheet) -> None:
        v = s.state("velocity", "m/s", 1.0)
        s.rate(v, s.input("force", "N") - dry_friction(s, v, "smooth"))
        s.output("speed", "m/s", v)

    assert "load_dependent_friction" not in {e.name for e in admitted(build(plain))}
