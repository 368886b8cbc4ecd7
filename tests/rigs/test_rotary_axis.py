"""The rotary axis: its equation at points computed by hand, its drives and loops, its units."""

import math

import casadi as ca
import numpy as np
import pytest

from optid.core.sheet import build
from optid.effects.library import admitted, find_effect
from optid.errors import PlantError
from optid.rigs.rigfile import read_rig
from optid.rigs.rotary_axis import GRAVITY, rotary_axis
from tests.effects.plants import DATA

VALUES = {
    "gear_ratio": 10.0,
    "armature": 1e-4,
    "load_inertia": 0.02,
    "payload_mass": 0.5,
    "arm_length": 0.2,
    "viscous_friction": 0.1,
    "coulomb_friction": 0.3,
}
INERTIA = 100 * 1e-4 + 0.02 + 0.5 * 0.04  # kg m2: 0.05
MOTOR = {"torque_constant": 0.1, "resistance": 2.0}
LOOP = {"position_gain": 20.0, "speed_gain": 0.5, "speed_integral_gain": 3.0, "drive_limit": 4.0}


def rates(model, state, command, **values):
    p = model.vector({**VALUES, **values})
    return np.array(model.rates(state, [command], p)).ravel()


def test_torques_at_speed_add_up():
    model = build(rotary_axis, friction="smooth")
    gravity = 0.5 * GRAVITY * 0.2 * math.sin(0.4)
    wanted = (10 * 0.08 - 0.1 * 2.0 - 0.3 - gravity) / INERTIA
    assert rates(model, [0.4, 2.0], 0.08) == pytest.approx([2.0, wanted], rel=1e-9)
    tilted = (10 * 0.08 - 0.1 * 2.0 - 0.3 - 0.5 * GRAVITY * 0.2 * math.sin(0.1) + 0.05) / INERTIA
    assert rates(model, [0.4, 2.0], 0.08, zero_offset=-0.3, load_torque=0.05)[1] == pytest.approx(tilted)


@pytest.mark.parametrize(
    ("drive", "torque"), [("torque", 3.0), ("current", 0.3), ("voltage", 0.1 * (3.0 - 0.1 * 10 * 2.0) / 2.0)]
)
def test_a_drive_turns_its_command_into_torque(drive, torque):
    model = build(rotary_axis, drive=drive, friction="smooth")
    own = MOTOR if drive == "voltage" else {"torque_constant": 0.1} if drive == "current" else {}
    wanted = (10 * torque - 0.1 * 2.0 - 0.3) / INERTIA
    assert rates(model, [0.0, 2.0], 3.0, **own)[1] == pytest.approx(wanted, rel=1e-9)
    assert {port.role: port.unit for port in model.recorded} == {
        "command": {"torque": "N m", "current": "A", "voltage": "V"}[drive]
    }


def test_a_drives_own_loops_are_cascaded_and_their_integral_stops_at_the_limit():
    model = build(rotary_axis, drive="current", loop="position", friction="smooth")
    own = {"torque_constant": 0.1, **LOOP}
    # 20 (0.3 - 0.2) - 1.5 = 0.5 rad/s too slow: 0.5 * 0.5 + 0.2 = 0.45 A.
    x, v, kept = rates(model, [0.2, 1.5, 0.2], 0.3, **own)
    gravity = 0.5 * GRAVITY * 0.2 * math.sin(0.2)
    assert (x, kept) == pytest.approx((1.5, 3.0 * 0.5))
    assert v == pytest.approx((10 * 0.1 * 0.45 - 0.1 * 1.5 - 0.3 - gravity) / INERTIA)
    # 38.5 rad/s too slow asks for 19.45 A and gets 4: the integral is led back by 15.45 / 0.5 rad/s.
    assert rates(model, [0.2, 1.5, 0.2], 2.2, **own)[2] == pytest.approx(3.0 * (38.5 - 15.45 / 0.5))
    speed = build(rotary_axis, loop="velocity", friction="smooth")
    assert speed.recorded[0].unit == "rad/s"
    with pytest.raises(PlantError, match="loop"):
        build(rotary_axis, loop="torque")


def test_laws_for_a_slide_come_in_the_units_of_a_joint_and_in_proportion():
    effects = {effect.name: effect for effect in admitted(build(rotary_axis))}
    unit = {(e.name, q.name): q.unit for e in effects.values() for q in e.parameters}
    assert unit["constant_force", "force"] == "N m"
    assert unit["spring_load", "stiffness"] == "N m/rad"
    assert unit["quadratic_drag", "drag"] == "N m s**2/rad**2"
    assert unit["transmission_compliance", "compliance"] == "rad/(N m)"
    (speed,) = (q for q in effects["stribeck_friction"].parameters if q.name == "stribeck_speed")
    plain = find_effect("stribeck_friction", DATA)
    # An axis that goes 1 rad where a slide goes 0.1 m.
    assert speed.typical == pytest.approx(
        10 * next(q for q in plain.parameters if q == speed or q.name == speed.name).typical
    )
    assert effects["constant_force"].strength["force"] == pytest.approx(
        0.01 * find_effect("constant_force", DATA).strength["force"]
    )
    assert "1 rad from there" in effects["spring_load"].says
    model = build(rotary_axis, [effects["spring_load"]], friction="smooth")
    given = {"spring_load.stiffness": 0.2, "spring_load.relaxed_position": 0.0, "spring_load.hardening": 0.5}
    wanted = (-0.2 * 1.0 * 1.5 - 0.5 * GRAVITY * 0.2 * math.sin(1.0)) / INERTIA
    assert rates(model, [1.0, 0.0], 0.0, **given)[1] == pytest.approx(wanted)


def test_a_rig_file_has_effects_in_the_axis_own_units(tmp_path):
    text = (DATA / "rotary_axis.toml").read_text()
    (tmp_path / "rig.toml").write_text(text + '\n[effects.constant_force]\nforce = "0.2 N m"\n')
    rig = read_rig(tmp_path / "rig.toml")
    assert rig.parameters["constant_force.force"] == pytest.approx(0.2)


@pytest.mark.parametrize("name", ["transmission_compliance", "transmission_backlash"])
def test_motor_and_load_keep_their_momentum_behind_a_shaft_that_gives(name):
    """J_m (w + twist') + J_l w changes by what drives and what loads, whatever the shaft transmits."""
    effects = {effect.name: effect for effect in admitted(build(rotary_axis))}
    model = build(rotary_axis, [effects[name]], friction="smooth")
    point = effects[name].qualified(effects[name].usual[-1])
    names = [state.name for state in model.states]
    p = model.vector({**VALUES, **point})
    x = np.array(
        [
            {"position": 0.3, "velocity": 1.2, f"{name}.twist": 0.02, f"{name}.twist_rate": -0.4}[n]
            for n in names
        ]
    )
    rate = dict(zip(names, np.array(model.rates(x, [0.05], p)).ravel(), strict=True))
    motor, load = 100 * 1e-4, INERTIA - 100 * 1e-4
    total = motor * (rate["velocity"] + rate[f"{name}.twist_rate"]) + load * rate["velocity"]
    drive = 10 * 0.05 - 0.1 * 1.2 - 0.3 - 0.5 * GRAVITY * 0.2 * math.sin(0.3)
    assert total == pytest.approx(drive, rel=1e-9)
    assert abs(rate["velocity"] - drive / INERTIA) > 1.0  # and it does give


def test_an_encoder_on_the_motor_shows_what_the_shaft_gives():
    (effect,) = (e for e in admitted(build(rotary_axis)) if e.name == "transmission_compliance")
    seen = {}
    for encoder in ("load", "motor"):
        model = build(rotary_axis, [effect], friction="smooth", encoder=encoder)
        p = model.vector({**VALUES, **effect.qualified(effect.usual[-1])})
        x = ca.DM(
            [{"position": 0.3, "transmission_compliance.twist": 0.02}.get(s.name, 0.0) for s in model.states]
        )
        seen[encoder] = float(model.sensors(x, [0.0], p))
    assert seen == pytest.approx({"load": 0.3, "motor": 0.32})


def test_cogging_repeats_over_the_motors_turn():
    (effect,) = (e for e in admitted(build(rotary_axis)) if e.name == "cogging")
    model = build(rotary_axis, [effect], friction="smooth")
    point = effect.qualified({"amplitude": 0.04, "per_turn": 12.0, "phase": 0.3})
    for q in (0.0, 0.01, 0.1):
        alone, both = (rates(model, [q, 0.0], 0.0, **own)[1] for own in ({}, point))
        assert (both - alone) * INERTIA == pytest.approx(0.04 * math.sin(12 * 10 * q + 0.3), abs=1e-9)
