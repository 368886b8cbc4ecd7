"""The sheet's contract: what a plant may write, what a site does, and what is refused in words."""

import casadi as ca
import numpy as np
import pytest

from optid.core.parameter import Parameter
from optid.core.sheet import build
from optid.errors import InputError, PlantError

DRAG = Parameter("drag", "N s/m", 2.0, "drag", "a test", bounds=(0.0, 10.0))
GAIN = Parameter("gain", "N", 1.0, "push", "a test", 3.0)
EXTRA = Parameter("extra", "N", 1.0, "more drag", "a test", 0.0)


def axis(s, *, doubled=False):
    """x' = v, v' = gain u - drag v."""
    x, v = s.state("x", "m", 0.1), s.state("v", "m/s", 1.0, start=0.5, spread=0.2)
    drag = s.site("force.friction", s.param(DRAG) * v, unit="N", v=v, x=x)
    s.rate(x, v)
    s.rate(v, (2 if doubled else 1) * s.param(GAIN) * s.input("u", "1") - drag)
    s.output("x", "m", s.site("sensor.x", x))


class More:
    """Adds a parameter and a state of its own at two sites."""

    name, sites, ahead_of = "more", ("force.friction", "sensor.x"), ()

    def apply(self, site, nominal, near, sheet):
        if site == "sensor.x":
            return nominal + sheet.recall("seen")
        z = sheet.state("z", "m", 1.0)
        sheet.rate(z, near["v"] - z)
        sheet.store("seen", z)
        return nominal + sheet.param(EXTRA) * ca.tanh(near["v"]) + 0 * sheet.plant_param("drag")


def rates(model, x, u, **values):
    return np.array(model.rates(x, u, model.vector({"drag": 2.0, **values}))).ravel()


def test_a_model_holds_what_the_plant_wrote():
    model = build(axis)
    assert [(s.name, s.unit, s.scale) for s in model.states] == [("x", "m", 0.1), ("v", "m/s", 1.0)]
    assert [(q.name, q.default) for q in model.parameters] == [("drag", None), ("gain", 3.0)]
    assert [(port.role, port.unit) for port in model.inputs + model.outputs] == [("u", "1"), ("x", "m")]
    assert model.sites == ("force.friction", "sensor.x")
    assert model.site_units == ("N", "")  # the second one is not stated
    assert rates(model, [0.0, 0.5], [0.25]) == pytest.approx([0.5, 3 * 0.25 - 2 * 0.5])
    mean, spread = (np.array(a).ravel() for a in model.start(model.vector({"drag": 2.0})))
    assert mean == pytest.approx([0.0, 0.5])
    assert spread == pytest.approx([1.0, 0.2])  # ten scales where the plant says nothing


def test_options_are_the_plants_own():
    assert rates(build(axis, doubled=True), [0.0, 0.0], [1.0])[1] == 6.0
    with pytest.raises(PlantError, match="doubled"):
        build(axis, double=True)


def test_a_site_without_effects_returns_its_argument():
    seen = []

    def plant(s):
        x = s.state("x", "m", 1.0)
        seen.append((x, s.site("here", x)))
        s.rate(x, -x)
        s.output("x", "m", x)

    build(plant)
    assert seen[0][0] is seen[0][1]


def test_an_effect_brings_parameters_and_states_under_its_own_name():
    plain, model = build(axis), build(axis, [More()])
    assert [s.name for s in model.states] == ["x", "v", "more.z"]
    assert [q.name for q in model.parameters] == ["drag", "more.extra", "gain"]
    assert model.effects == ("more",)
    null = rates(model, [0.1, 0.5, 0.0], [0.2])
    assert null[:2] == pytest.approx(rates(plain, [0.1, 0.5], [0.2]))
    assert rates(model, [0.1, 0.5, 0.0], [0.2], **{"more.extra": 1.0})[1] == pytest.approx(
        null[1] - np.tanh(0.5)
    )
    assert float(model.sensors([0.1, 0.5, 0.3], [0.2], model.vector({"drag": 2.0}))[0]) == pytest.approx(0.4)


def refused(write, match, effects=()):
    with pytest.raises(PlantError, match=match):
        build(write, effects)


def test_what_does_not_close_is_refused():
    def without_rate(s):
        s.output("x", "m", s.state("x", "m", 1.0))

    def without_output(s):
        x = s.state("x", "m", 1.0)
        s.rate(x, -x)

    def twice(s):
        s.state("x", "m", 1.0)
        s.state("x", "m", 1.0)

    def two_rates(s):
        x = s.state("x", "m", 1.0)
        s.rate(x, -x)
        s.rate(x, x)

    def foreign(s):
        x = s.state("x", "m", 1.0)
        s.rate(x, ca.SX.sym("stray") * x)
        s.output("x", "m", x)

    def two_meanings(s):
        s.param(DRAG)
        s.param(Parameter("drag", "N", 2.0, "another", "a test"))

    refused(without_rate, "no rate for x")
    refused(without_output, "no output")
    refused(twice, '"x" is declared twice')
    refused(two_rates, '"x" is declared twice')
    refused(foreign, "never|no state, input or parameter")
    refused(two_meanings, "different attributes")
    refused(lambda s: s.rate(ca.SX.sym("y"), 0.0), "which is no state")


def test_an_effect_that_does_not_fit_is_refused():
    class Lost:
        name, sites, ahead_of = "lost", ("force.fricton",), ()

    class Greedy:
        name, sites, ahead_of = "greedy", ("force.friction",), ()

        def apply(self, site, nominal, near, sheet):
            return nominal + near["acceleration"]

    refused(axis, 'acts at site "force.fricton".*', [Lost()])
    refused(axis, 'needs the signal "acceleration"', [Greedy()])


def test_values_must_be_known_and_complete():
    model = build(axis)
    with pytest.raises(InputError, match="drag"):
        model.vector({})
    assert model.vector({"drag": 1.0}) == pytest.approx([1.0, 3.0])
