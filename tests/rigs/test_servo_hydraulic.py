"""The servo-hydraulic axis: flows, stiffness and balances at points computed by hand."""

import math

import casadi as ca
import numpy as np
import pytest

from optid.core.sheet import build
from optid.core.simulation import simulate
from optid.effects.library import admitted
from optid.errors import RigError
from optid.rigs.rigfile import read_rig
from optid.rigs.servo_hydraulic import servo_hydraulic
from tests.effects.plants import DATA

VALUES = dict(read_rig(DATA / "servo_hydraulic.toml").parameters)
A_A = math.pi / 4 * 0.04**2
A_ROD = math.pi / 4 * 0.028**2
A_B = A_A - A_ROD
STATES = ("position", "velocity", "pressure_a", "pressure_b")


def rates(model, state, command, **values):
    own = dict(zip(STATES, state, strict=True))
    x = ca.DM([own.get(s.name, values.pop(s.name, 0.0)) for s in model.states])
    u = ca.DM([command if port.role == "command" else values.pop(port.role, 0.0) for port in model.inputs])
    found = np.array(model.rates(x, u, model.vector({**VALUES, **values}))).ravel()
    return dict(zip((s.name for s in model.states), found, strict=True))


def test_flows_and_forces_add_up():
    model = build(servo_hydraulic, friction="smooth")
    rate = rates(model, (0.02, 0.1, 4e6, 6e6), 0.5, air_content=0.0)
    leak = 1e-12 * (4e6 - 6e6)
    into_a = 20e-3 / 60 * 0.5 * math.sqrt((1e7 - 4e6) / 35e5) - leak - A_A * 0.1
    out_b = 20e-3 / 60 * 0.5 * math.sqrt((6e6 - 2e5) / 35e5)
    assert rate["pressure_a"] == pytest.approx(1.2e9 * into_a / (A_A * 0.12 + 5e-5), rel=1e-3)
    assert rate["pressure_b"] == pytest.approx(
        1.2e9 * (-out_b + leak + A_B * 0.1) / (A_B * 0.08 + 5e-5), rel=1e-3
    )
    force = A_A * 4e6 - A_B * 6e6 - A_ROD * 1e5 - 1500 * 0.1 - 300
    assert rate["velocity"] == pytest.approx(force / 150, rel=1e-9)


@pytest.mark.parametrize("drop", [5e5, 2e6])
def test_small_drops_pass_an_edge_as_an_orifice(drop):
    """Where the laminar part is felt far above its width, fits take the missing flow from friction."""
    model = build(servo_hydraulic, friction="smooth")
    at = (0.0, 0.0, 1e7 - drop, 2e5)
    rate = rates(model, at, 0.5, internal_leakage=0.0, air_content=0.0)["pressure_a"]
    into_a = 20e-3 / 60 * 0.5 * math.sqrt(drop / 35e5)
    assert rate == pytest.approx(1.2e9 * into_a / (A_A * 0.1 + 5e-5), rel=3e-4)


def test_edges_that_overlap_pass_nothing_and_edges_that_do_not_pass_both_ways():
    model = build(servo_hydraulic, friction="smooth")
    at = (0.0, 0.0, 5e6, 5e6)
    assert rates(model, at, 0.01, valve_lap=0.02, internal_leakage=0.0)["pressure_a"] == 0.0
    open_ = rates(model, at, 0.0, valve_lap=-0.02, internal_leakage=0.0, air_content=0.0)["pressure_a"]
    both = 20e-3 / 60 * 0.02 * (math.sqrt(5e6 / 35e5) - math.sqrt(4.8e6 / 35e5))
    assert open_ == pytest.approx(1.2e9 * both / (A_A * 0.1 + 5e-5), rel=0.01)


def test_air_makes_oil_soft_at_low_pressure():
    """Jelali and Kroll's effective modulus: at 5 bar 0.5 % of air leaves a quarter of it, at 90 bar nearly all."""
    model = build(servo_hydraulic, friction="smooth")

    def share(P, air):
        soft, hard = (rates(model, (0.0, 0.1, P, P), 0.0, air_content=a)["pressure_a"] for a in (air, 0.0))
        return soft / hard

    bubbles = 0.005 * 5 ** (-1 / 1.4)
    wanted = (0.995 + bubbles) / (0.995 + 1.2e9 * bubbles / (1.4 * 5e5))
    assert share(5e5, 0.005) == pytest.approx(wanted, rel=1e-6)
    assert share(5e5, 0.005) < 0.3 < 0.9 < share(9e6, 0.005)


def test_air_found_is_as_good_as_air_stated():
    (effect,) = (e for e in admitted(build(servo_hydraulic)) if e.name == "air_in_oil")
    model = build(servo_hydraulic, [effect], friction="smooth")
    found = effect.qualified({"content": 0.004, "exponent": 1.4})
    at = (0.0, 0.1, 3e6, 3e6)
    stated = rates(model, at, 0.0, air_content=0.004)["pressure_a"]
    assert rates(model, at, 0.0, air_content=0.0, **found)["pressure_a"] == pytest.approx(stated, rel=0.01)


def test_leaks_follow_the_drop_and_its_root():
    effects = {e.name: e for e in admitted(build(servo_hydraulic))}
    still = {"internal_leakage": 0.0, "air_content": 0.0}
    volume = A_A * 0.1 + 5e-5
    at = (0.0, 0.0, 8e6, 2e6)
    for name, size, flow in (
        ("laminar_leakage", 2e-12, 2e-12 * 6e6),
        ("turbulent_leakage", 1e-7, 1e-7 * math.sqrt(2 * 6e6 / 870)),
    ):
        model = build(servo_hydraulic, [effects[name]], friction="smooth")
        rate = rates(model, at, 0.0, **still, **{f"{name}.across": size})
        assert rate["pressure_a"] * volume / 1.2e9 == pytest.approx(-flow, rel=1e-3)
        assert rate["pressure_b"] > 0
        drained = rates(model, at, 0.0, **still, **{f"{name}.from_a": size})
        assert drained["pressure_a"] < rate["pressure_a"] and drained["pressure_b"] == pytest.approx(0.0)


def test_viscosity_moves_friction_and_leaks_against_each_other():
    (effect,) = (e for e in admitted(build(servo_hydraulic)) if e.name == "viscosity_drift")
    model = build(servo_hydraulic, [effect], friction="smooth")
    own = effect.qualified({"rate": -0.05, "settling_time": 1e4})
    at = (0.0, 0.1, 8e6, 2e6)
    cold, warm = (rates(model, at, 0.0, clock=t, **own) for t in (0.0, 10.0))
    thin = math.exp(2 * math.tanh(-0.5 / 2))
    assert (warm["velocity"] - cold["velocity"]) * 150 == pytest.approx(1500 * 0.1 * (1 - thin), rel=1e-3)
    assert warm["pressure_a"] < cold["pressure_a"]


def test_an_accumulator_gives_what_the_valve_takes_until_the_pump_makes_up_for_it():
    model = build(servo_hydraulic, supply="accumulator", friction="smooth")
    own = {
        "pump_flow": 1e-4,
        "pump_droop": 1e6,
        "accumulator_volume": 1e-3,
        "precharge_pressure": 5e6,
        "air_content": 0.0,
    }
    line = rates(model, (0.0, 0.0, 4e6, 4e6), 0.5, supply_line=9.5e6, **own)["supply_line"]
    taken = 20e-3 / 60 * 0.5 * math.sqrt(5.5e6 / 35e5)
    gas = 1e-3 * (5e6 / 9.5e6) ** (1 / 1.4)
    assert line == pytest.approx(1.4 * 9.5e6 / gas * (0.5e-4 - taken), rel=1e-3)


def test_what_cannot_be_built_is_refused(tmp_path):
    text = (DATA / "servo_hydraulic.toml").read_text()
    (tmp_path / "rig.toml").write_text(text.replace('rod_diameter = "28 mm"', 'rod_diameter = "45 mm"'))
    with pytest.raises(RigError, match="thinner than the bore"):
        read_rig(tmp_path / "rig.toml")


def test_oil_boils_where_a_load_pulls():
    """A chamber of oil without air that a load widens: near its vapour pressure, and what was added is vapour."""
    model = build(servo_hydraulic, friction="smooth")
    own = {**VALUES, "air_content": 0.0, "internal_leakage": 0.0, "load_force": 4e4, "coulomb_friction": 0.0}
    start = {"pressure_a": 2.6e6, "pressure_b": 5.1e6}
    n = 600
    run = simulate(
        model,
        model.vector(own),
        np.array([start.get(s.name, 0.0) for s in model.states]),
        np.full(n, 1e-3),
        np.zeros((n, len(model.inputs))),
    )
    x, _, P_a, P_b = (run.states[0, :, [s.name for s in model.states].index(name)] for name in STATES)
    assert P_a.min() > 0.0
    widened = A_A * x[-1] / (A_A * 0.1 + 5e-5)
    assert (1e3 / P_a[-1]) ** 4 == pytest.approx(widened, rel=0.05)
    assert P_b[-1] > 3e7


def test_oil_that_flows_in_fills_vapour_first():
    """At p_v half of the chamber is vapour, and twice its own volume of that mixture goes for one of oil."""
    model = build(servo_hydraulic, friction="smooth")
    own = {"air_content": 0.0, "internal_leakage": 0.0, "supply_pressure": 35e5 + 1e3}
    rate = rates(model, (0.0, 0.0, 1e3, 5e6), 1.0, **own)["pressure_a"]
    share_of_volume = 20e-3 / 60 / (A_A * 0.1 + 5e-5)
    assert rate == pytest.approx(share_of_volume * 2 * 2 / 4 * 1e3, rel=1e-3)
    sound = rates(model, (0.0, 0.1, 3e5, 5e6), 0.0, **own)["pressure_a"]
    assert sound == pytest.approx(-1.2e9 * A_A * 0.1 / (A_A * 0.1 + 5e-5), rel=1e-5)
