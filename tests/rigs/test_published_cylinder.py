"""The servo-hydraulic axis beside a published parameter set and the closed relations of the books."""

import math
from pathlib import Path

import numpy as np
import pytest

from optid.core.linearise import linearise
from optid.core.simulation import simulate
from optid.rigs.rigfile import read_rig

ROOT = Path(__file__).parents[2]
PUBLISHED = read_rig(ROOT / "studies" / "published_cylinder.toml")
AREA, BULK, VOLUME, MASS = 32.3e-4, 1.2e9, 819e-6, 450.0  # example 17-2
GAIN = 2.46e-6 * 0.031e-2 / 1e-6 / 1e-3  # m/s per A: servo valve times cylinder


def swings(rig, **held):
    """Natural frequency with the valve closed, rad/s."""
    found = linearise(
        rig.model, rig.parameters, {"command": 0.0, "velocity": 0.0, **held}, near={"command": 0.0}
    )
    return np.abs(np.imag(found.system.poles())).max()


def end_state(rig, command, seconds=1.5, **values):
    """States by name after a held command from rest."""
    model, samples = rig.model, round(seconds / 1e-3) + 1
    p = model.vector({**rig.parameters, **values})
    inputs = np.zeros((samples, len(model.inputs)))
    inputs[:, [port.role for port in model.inputs].index("command")] = command
    start = np.array(model.start(p)[0]).ravel()
    states = simulate(model, p, start, np.full(samples, 1e-3), inputs).states[0, -1]
    return dict(zip((s.name for s in model.states), states, strict=True))


def test_natural_frequency_is_the_examples_and_rises_towards_the_ends():
    """A sqrt(2 E / (V M)) = 260.6 rad/s with V on either side, which is Merritt's 4 E A^2 / (V_t M)."""
    published = AREA * math.sqrt(2 * BULK / (VOLUME * MASS))
    assert published == pytest.approx(260.6, abs=0.1)
    assert swings(PUBLISHED, position=0.0) == pytest.approx(published, rel=1e-3)
    off = 0.08
    wanted = AREA * math.sqrt(BULK / MASS * sum(1 / (VOLUME + way * AREA * off) for way in (1, -1)))
    assert swings(PUBLISHED, position=off) == pytest.approx(wanted, rel=1e-3)
    assert wanted > 1.04 * published


@pytest.mark.parametrize("current", [0.01, -0.03])
def test_steady_speed_is_servo_valve_gain_times_cylinder_gain(current):
    """The example's 0.031 cm/cm3 is 1 / 32.3 cm2 rounded by 0.13 %."""
    speed = end_state(PUBLISHED, current / 0.1, viscous_friction=2e4)["velocity"]
    drag = 2e4 * GAIN * abs(current) / AREA / 209e5  # share of the supply that friction takes
    assert speed == pytest.approx(GAIN * current * math.sqrt(1 - drag), rel=2e-3)


@pytest.mark.parametrize("command", [0.2, -0.2])
def test_unequal_areas_move_and_press_as_the_books_say(command):
    """v = Q_N u / A sqrt((p_s - a p_t - F/A) / (p_N (1 + a^3))) out, (a p_s - p_t + F/A) in; a is A_b / A_a."""
    rig, force = read_rig(ROOT / "data" / "servo_hydraulic.toml"), -2000.0
    p = {**rig.parameters, "air_content": 0.0, "internal_leakage": 0.0, "coulomb_friction": 0.0}
    area = math.pi / 4 * p["bore_diameter"] ** 2
    ratio = 1 - (p["rod_diameter"] / p["bore_diameter"]) ** 2
    low, high = p["tank_pressure"], p["supply_pressure"]
    load = (-force + (1 - ratio) * area * p["atmospheric_pressure"]) / area  # what the piston must bear, Pa
    spare = high - ratio * low - load if command > 0 else ratio * high - low + load
    # Friction takes part of the pressure: v is found again with it, from the speed without.
    flow, viscous = p["rated_flow"] * abs(command), p["viscous_friction"]
    speed = 0.0
    for _ in range(50):
        left = spare - viscous * speed / area
        speed = flow / area * math.sqrt(left / (p["rated_pressure_drop"] * (1 + ratio**3)))
    found = end_state(
        rig, command, 0.4, **{k: p[k] for k in p if p[k] != rig.parameters.get(k)}, load_force=force
    )
    assert found["velocity"] == pytest.approx(math.copysign(speed, command), rel=3e-3)
    drop = p["rated_pressure_drop"] * (area * speed / flow) ** 2
    a, b = (high - drop, low + ratio**2 * drop) if command > 0 else (low + drop, high - ratio**2 * drop)
    assert found["pressure_a"] == pytest.approx(a, rel=3e-3)
    assert found["pressure_b"] == pytest.approx(b, rel=3e-3)


def test_rated_flow_flows_at_the_rated_drop():
    rig = PUBLISHED
    p, area = rig.parameters, AREA
    found = end_state(rig, 0.5, 0.8, viscous_friction=3e5)
    flow = area * found["velocity"]
    drop = p["supply_pressure"] - found["pressure_a"]
    assert flow == pytest.approx(p["rated_flow"] * 0.5 * math.sqrt(drop / p["rated_pressure_drop"]), rel=2e-3)
    assert 0.2 < drop / p["rated_pressure_drop"] < 0.9
