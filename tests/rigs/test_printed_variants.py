"""Each reading of the printed equations that a rig file can ask for, against numbers computed by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from optid.core.sheet import build
from optid.rigs.servo_pneumatic import servo_pneumatic

TABLE_1 = {
    "supply_pressure": 7e5,
    "exhaust_pressure": 1e5,
    "atmospheric_pressure": 1e5,
    "supply_temperature": 293.0,
    "chamber_temperature": 293.0,
    "specific_heat_ratio": 1.4,
    "gas_constant": 287.0,
    "port_width": 6.2e-3,
    "spool_travel": 4e-3,
    "bore_diameter": 42e-3,
    "rod_diameter": 16e-3,
    "stroke": 0.26,
    "residual_length": 0.01,
    "payload_mass": 1.9,
    "discharge_coefficient": 0.8,
    "viscous_friction": 78.0,
    "coulomb_friction": 83.0,
}
A_A, A_ROD = math.pi / 4 * 0.042**2, math.pi / 4 * 0.016**2
C_0 = 0.040418  # paper/notes: for air


def rates(P_a, P_b, v, u, other=None, **options):
    """Rates by state name at mid-stroke."""
    model = build(servo_pneumatic, **options)
    values = {k: x for k, x in (TABLE_1 | (other or {})).items() if k in {p.name for p in model.parameters}}
    at = {"position": 0.0, "velocity": v, "pressure_a": P_a, "pressure_b": P_b}
    x = np.array([at.get(state.name, 0.0) for state in model.states])
    found = np.array(model.rates(x, np.array([u]), model.vector(values))).ravel()
    return dict(zip([state.name for state in model.states], found.tolist(), strict=True))


def test_the_print_leaves_20_n_out():
    """Eq. 11 with and without A_rod P_atm = 2.0106e-4 m2 x 1e5 Pa = 20.106 N, over 1.9 kg."""
    read, printed = (
        rates(3e5, 3e5, 0.2, 0.0, rod_force=on, friction="smooth")["velocity"] for on in (True, False)
    )
    assert printed - read == pytest.approx(20.1062 / 1.9, rel=1e-4)


def test_f_r_to_the_letter_pushes():
    """83 N whichever way it moves: at 0.2 and -0.2 m/s the accelerations differ by viscous friction alone."""
    there, back = (rates(3e5, 3e5, v, 0.0, friction="constant")["velocity"] for v in (0.2, -0.2))
    assert back - there == pytest.approx(2 * 78 * 0.2 / 1.9, rel=1e-4)
    still = (A_A * 3e5 - (A_A - A_ROD) * 3e5 - A_ROD * 1e5 - 83.0) / 1.9
    assert (there + back) / 2 == pytest.approx(still, rel=1e-4)


def test_four_forward_cases_let_nothing_back():
    """A chamber above the supply: the print's eq. 3 passes nothing, the corrected reading blows back."""
    printed = rates(8e5, 3e5, 0.0, 1.0, reversed_flow=False)["pressure_a"]
    read = rates(8e5, 3e5, 0.0, 1.0)["pressure_a"]
    assert printed == pytest.approx(0.0, abs=1.0)
    assert read < -1e5


def test_ports_of_their_own_widths():
    """Choked filling of A: K/L R T_s/A_a C_d C_0 W_a X P_s/sqrt(T_s), by hand; B's exhaust goes with W_b alone."""
    widths = {"port_width_b": 3.1e-3}
    both = rates(2e5, 5e5, 0.0, 1.0, widths, separate_ports=True)
    same = rates(2e5, 5e5, 0.0, 1.0)
    by_hand = 1.4 / 0.14 * 287 * 293 / A_A * 0.8 * C_0 * 6.2e-3 * 4e-3 * 7e5 / math.sqrt(293)
    assert both["pressure_a"] == pytest.approx(by_hand, rel=2e-3)
    assert both["pressure_a"] == pytest.approx(same["pressure_a"], rel=1e-12)
    assert both["pressure_b"] == pytest.approx(same["pressure_b"] / 2, rel=1e-9)


def test_chambers_of_their_own_temperatures():
    """What leaves B goes with 1/sqrt(T_b), eq. 4; A's filling knows the supply's temperature only."""
    warm = {"chamber_temperature_b": 4 * 293.0}
    apart = rates(2e5, 5e5, 0.0, 1.0, warm, separate_temperatures=True)
    same = rates(2e5, 5e5, 0.0, 1.0)
    assert apart["pressure_a"] == pytest.approx(same["pressure_a"], rel=1e-12)
    assert apart["pressure_b"] == pytest.approx(same["pressure_b"] / 2, rel=1e-9)
