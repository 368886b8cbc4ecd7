"""Which effects a plant admits, and what is said when one does not fit."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from optid.core.sheet import build
from optid.diagnosis.surrogate.library import _moving
from optid.diagnosis.verdict import _not_testable
from optid.effects.library import admitted, built_in, find_effect, untestable
from optid.errors import PlantError, RigError
from optid.rigs.cascaded_tanks import cascaded_tanks
from optid.rigs.emps import emps
from optid.rigs.friction import dry_friction
from optid.rigs.servo_pneumatic import servo_pneumatic
from tests.effects.plants import grown


@pytest.mark.parametrize(
    ("plant", "options"),
    [
        (servo_pneumatic, {"friction": "smooth"}),
        (servo_pneumatic, {"friction": "constant"}),
        (servo_pneumatic, {"reversed_flow": False, "rod_force": False}),
        (emps, {"direction": "separate"}),
    ],
)
def test_every_variant_of_a_plant_takes_all_that_it_admits(plant, options):
    plain = build(plant, **options)
    model = build(plant, admitted(plain), **options)
    rng = np.random.default_rng(1)
    x, u = 0.1 * rng.normal(size=len(model.states)), 0.1 * rng.normal(size=len(model.inputs))
    names, inputs = [s.name for s in model.states], [(q.role, q.ago) for q in model.inputs]
    for name in ("pressure_a", "pressure_b"):
        if name in names:
            x[names.index(name)] = rng.uniform(2e5, 6e5)
    own = [names.index(s.name) for s in plain.states]
    base = {q.name: (q.typical if q.default is None else q.default) for q in plain.parameters}
    rates = np.array(model.rates(x, u, model.vector(base))).ravel()
    nominal = plain.rates(
        x[own], u[[inputs.index((q.role, q.ago)) for q in plain.inputs]], plain.vector(base)
    )
    assert np.isfinite(rates[own]).all()
    assert rates[own] == pytest.approx(np.array(nominal).ravel(), rel=1e-10, abs=1e-9)


def test_bristles_are_needed_for_effects_within_them():
    names = {effect.name for effect in admitted(build(servo_pneumatic, friction="smooth"))}
    assert "presliding" not in names and "stribeck_friction" in names


def test_an_effect_for_any_site_is_found_by_its_name():
    effect = find_effect("saturation@flow.inlet", Path())
    assert (effect.name, effect.sites, effect.site) == (
        "saturation@flow.inlet",
        ("flow.inlet",),
        "flow.inlet",
    )
    with pytest.raises(RigError, match="saturation"):
        find_effect("saturate@flow.inlet", Path())


def test_an_effect_for_any_site_takes_the_size_that_the_plant_states():
    plant = grown("cascaded-tanks")
    (effect,) = (e for e in plant.effects if e.name == "dead_zone@flow.inlet")
    assert effect.strength["width"] == pytest.approx(0.2 * 0.01)
    read = build(cascaded_tanks, [find_effect("dead_zone@flow.inlet", Path())])
    assert read.parameters[read.index("dead_zone@flow.inlet.width")].typical == pytest.approx(0.2 * 0.1)


def axis(s):
    """A user's plant: its site has a known name, and no signals near."""
    x, v = s.state("x", "m", 1.0), s.state("v", "m/s", 1.0)
    s.rate(x, v)
    s.rate(v, s.site("force.external", -x))
    s.output("x", "m", x)


def test_what_does_not_find_its_signals_is_not_offered():
    names = {effect.name for effect in admitted(build(axis))}
    assert names == {"constant_force", "periodic_disturbance"}


def test_a_signal_that_a_plant_does_not_declare_is_named():
    with pytest.raises(PlantError, match=r'spring_load.*"x".*force\.external'):
        build(axis, [built_in()["spring_load"]])


def test_overlap_and_underlap_of_one_valve_exclude_each_other():
    plain = build(servo_pneumatic)
    assert {"valve_deadband", "valve_underlap"} <= {effect.name for effect in admitted(plain)}
    for there, out in (("valve_deadband", "valve_underlap"), ("valve_underlap", "valve_deadband")):
        model = build(servo_pneumatic, (built_in()[there],))
        names = {effect.name for effect in admitted(model)}
        assert out not in names
        assert "valve_lag" in names


def slide(sheet, shown):
    """A body on a rough slide: a force moves it, and its speed or its place is measured."""
    x, v = sheet.state("position", "m", 0.1, spread=0.1), sheet.state("velocity", "m/s", 0.1)
    drag = sheet.site("force.friction", dry_friction(sheet, v, "smooth", x=x, L=1.0), size=10.0, x=x, v=v)
    sheet.rate(x, v)
    sheet.rate(v, sheet.input("force", "N") - drag)
    sheet.output("seen", "m", x if shown == "position" else v)


@pytest.mark.parametrize("shown", ["position", "velocity"])
def test_a_law_over_a_place_that_nothing_recorded_shows_is_not_tried(shown):
    """Each recording could begin anywhere in it: friction that differs between recordings would be told as a bump."""
    model = build(lambda sheet: slide(sheet, shown))
    hidden = {"position"} if shown == "velocity" else set()
    assert model.unobservable == hidden
    name = "position_dependent_friction"
    assert (name in {e.name for e in untestable(model)}) == bool(hidden)
    assert (name in {e.name for e in admitted(model)}) != bool(hidden)
    assert "stribeck_friction" in {e.name for e in admitted(model)}


@pytest.mark.parametrize("shown", ["position", "velocity"])
def test_it_is_said_to_be_untestable_and_no_curve_is_drawn_over_the_place(shown):
    model = build(lambda sheet: slide(sheet, shown))
    rounds = (SimpleNamespace(proposals=SimpleNamespace(visible={e.name: 9.0 for e in admitted(model)})),)
    path = SimpleNamespace(earlier=(), rounds=rounds, best=SimpleNamespace(effects=()))
    told = _not_testable(path, SimpleNamespace(rig=SimpleNamespace(model=model), own=()))
    said = [("position_dependent_friction", "nothing recorded shows position", "")]
    assert list(told) == (said if shown == "velocity" else [])
    states, inputs = np.zeros((9, len(model.states))), np.zeros((9, 1))
    base = SimpleNamespace(
        rig=SimpleNamespace(model=model),
        fit=SimpleNamespace(filtered=SimpleNamespace(states=[states])),
        likelihood_problem=SimpleNamespace(problem=SimpleNamespace(inputs=inputs)),
    )
    assert ("position" in _moving(base)) == (shown == "position")
    assert {"velocity", "force"} <= set(_moving(base))
