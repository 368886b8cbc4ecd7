"""The two tanks: balances at points computed by hand, the empty tank and the full sensor."""

import numpy as np
import pytest

from optid.core.sheet import build
from optid.rigs.cascaded_tanks import cascaded_tanks

VALUES = {"upper_outlet": 0.05, "lower_inlet": 0.04, "lower_outlet": 0.06, "pump_gain": 0.03}


@pytest.fixture(scope="module")
def model():
    return build(cascaded_tanks)


def rates(model, levels, command):
    return np.array(model.rates(levels, [command], model.vector(VALUES))).ravel()


def shown(model, level):
    return float(model.sensors([5.0, level], [0.0], model.vector(VALUES))[0])


def test_balances_are_the_published_ones(model):
    # sqrt(4) = 2, sqrt(9) = 3: -0.05*2 + 0.03*5 = 0.05; 0.04*2 - 0.06*3 = -0.1 (the smooth root: 6e-6 less).
    assert rates(model, [4.0, 9.0], 5.0) == pytest.approx([0.05, -0.1], rel=2e-5)


def test_smooth_root_costs_what_its_setting_says(model):
    flow = -rates(model, [0.1, 4.0], 0.0)[0] / 0.05
    assert flow == pytest.approx(np.sqrt(0.1), rel=0.0102)
    assert flow < np.sqrt(0.1)


def test_an_empty_tank_gives_nothing_and_refills_when_below(model):
    assert rates(model, [0.0, 0.0], 0.0) == pytest.approx([0.0, 0.0], abs=1e-15)
    assert np.all(rates(model, [-1e-3, -1e-3], 0.0) > [0.0, -1e-3])


@pytest.mark.parametrize(("level", "expected"), [(5.0, 5.0), (9.98, 9.98), (10.02, 10.0), (13.0, 10.0)])
def test_sensor_is_exact_outside_its_transition(model, level, expected):
    assert shown(model, level) == pytest.approx(expected, abs=1e-12)


def test_sensor_shows_a_quarter_width_less_at_its_ceiling(model):
    assert shown(model, 10.0) == pytest.approx(10.0 - 0.02 / 4, abs=1e-12)


def test_an_overflow_can_enter_and_falls_into_the_lower_tank():
    class Rim:
        name, sites, ahead_of = "rim", ("store.upper",), ()

        def apply(self, site, nominal, near, sheet):
            return nominal + 0.01 * near["h_1"]

    spilling = build(cascaded_tanks, [Rim()])
    plain = rates(build(cascaded_tanks), [4.0, 9.0], 5.0)
    assert rates(spilling, [4.0, 9.0], 5.0) - plain == pytest.approx([-0.04, 0.04], rel=1e-12)


def test_roles_and_sites(model):
    assert [(port.role, port.unit) for port in model.inputs + model.outputs] == [
        ("command", "V"),
        ("level", "V"),
    ]
    assert {"flow.inlet", "flow.between", "flow.outlet", "sensor.level", "store.upper"} <= set(model.sites)
