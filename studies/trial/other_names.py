"""What is concealed on the rotary and on the hydraulic axis: names of the catalogue, and physics that has none."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from studies.independent_axes import Hydraulic, Rotary
from studies.trial.sizes import Draw

Fields = Callable[[Draw], dict[str, float]]
Makers = Mapping[str, tuple[str, Fields]]  # name of an effect -> site, fields of the rig


@dataclass(frozen=True)
class Board:
    """A kind of axis on trial: its rig, what a user knows of it, the names and what has none."""

    rig: Any
    file: str
    base: Mapping[str, float]  # fields of the rig that a fit moves -> by what share they are off
    named: Makers
    outside: Makers


def _friction(force: float, speed: float, way: float) -> dict[str, tuple[str, Fields]]:
    """Laws that both axes have, at their usual force, speed and way."""
    return {
        "stribeck_friction": (
            "force",
            lambda d: {"stick_ratio": 1 + d.sized(0.15, 0.8), "stribeck_speed": speed * d.between(0.1, 0.6)},
        ),
        "asymmetric_friction": ("force", lambda d: {"asymmetry": d.sign() * d.sized(0.05, 0.3)}),
        "constant_force": ("force", lambda d: {"force": d.sign() * force * d.sized(0.05, 0.5)}),
        "position_dependent_friction": (
            "force",
            lambda d: {
                "place_amount": d.sized(0.2, 0.9),
                "place": way * d.evenly(-0.5, 0.5),
                "place_width": way * d.evenly(0.2, 0.5),
            },
        ),
        "spring_load": (
            "force",
            lambda d: {"spring": force / way * d.sized(0.2, 2.0), "spring_at": way * d.evenly(-0.4, 0.4)},
        ),
        "periodic_disturbance": (
            "force",
            lambda d: {
                "shake": force * d.sized(0.05, 0.5),
                "shake_frequency": d.between(0.8, 15.0),
                "shake_phase": d.evenly(0.0, 6.28),
            },
        ),
        "friction_drift": (
            "force",
            lambda d: {
                "friction_drift": d.sign() * d.sized(0.12, 0.5),
                "friction_drift_time": d.one_of(0.0, 3.0),
            },
        ),
        "sensor_backlash": ("sensor", lambda d: {"backlash": way * d.sized(5e-4, 5e-3)}),
        "sensor_lag": ("sensor", lambda d: {"sensor_time": d.sized(1e-3, 8e-3)}),
        "sensor_drift": ("sensor", lambda d: {"sensor_drift": d.sign() * way * d.sized(8e-3, 0.08)}),
    }


def _either(d: Draw, one: str, other: str) -> str:
    return (one, other)[int(d.one_of(0.0, 1.0))]


def _compliance(d: Draw) -> dict[str, float]:
    c = d.sized(0.02, 0.25)
    return {"compliance": c, "shaft_damping": 2 * d.evenly(0.03, 0.1) * (5.2e-3 / c) ** 0.5}


def _backlash(d: Draw) -> dict[str, float]:
    return {"play": d.sized(2e-3, 2e-2), "compliance": 2e-3, "shaft_damping": 0.15}


ROTARY = Board(
    Rotary(),
    "rotary_axis.toml",
    {"inertia": 0.3, "mass": 0.15, "viscous": 0.25, "coulomb": 0.2},
    {
        **_friction(0.5, 1.0, 1.0),
        "quadratic_drag": ("force", lambda d: {"drag": d.sized(2e-3, 2e-2)}),
        "load_dependent_friction": ("force", lambda d: {"load_friction": d.sized(0.03, 0.25)}),
        "cogging": (
            "drive",
            lambda d: {
                "cogging": d.sized(0.03, 0.25),
                "cogging_turn": d.one_of(4.0, 6.0, 12.0),
                "cogging_phase": d.evenly(-3.0, 3.0),
            },
        ),
        "transmission_compliance": ("force", _compliance),
        "transmission_backlash": ("force", _backlash),
        "delay@drive.command": ("drive", lambda d: {"delay": d.sized(1.5e-3, 1e-2)}),
        "dead_zone@drive.command": ("drive", lambda d: {"dead": d.sized(0.15, 1.5)}),
        "hysteresis@drive.command": ("drive", lambda d: {"hysteresis": d.sized(0.05, 0.5)}),
        "saturation@drive.command": ("drive", lambda d: {"limit": 10.0 - d.sized(1.0, 6.0)}),
    },
    {
        "dwell_friction": ("force", lambda d: {"dwell_gain": d.sized(0.4, 2.0)}),
        "copper_warming": ("drive", lambda d: {"warming": d.sized(0.1, 0.6)}),
        "torque_ripple": ("drive", lambda d: {"ripple": d.sized(0.05, 0.4)}),
        "voltage_sag": ("drive", lambda d: {"sag": d.sized(0.1, 0.6)}),
        "sensor_crosstalk": ("sensor", lambda d: {"crosstalk": d.sign() * d.sized(3e-4, 3e-3)}),
    },
)
HYDRAULIC = Board(
    Hydraulic(),
    "servo_hydraulic.toml",
    {"rated_flow": 0.15, "bulk": 0.15, "viscous": 0.25, "coulomb": 0.2},
    {
        **_friction(2000.0, 0.1, 0.08),
        "pressure_dependent_friction": ("force", lambda d: {"seal": d.sized(5e-6, 6e-5)}),
        "laminar_leakage": ("flow", lambda d: {_either(d, "leak_cross", "leak_a"): d.sized(5e-13, 8e-12)}),
        "turbulent_leakage": ("flow", lambda d: {_either(d, "score_cross", "score_a"): d.sized(2e-8, 3e-7)}),
        "air_in_oil": ("flow", lambda d: {"air": 5e-3 + d.sized(3e-3, 3e-2)}),
        "viscosity_drift": (
            "force",
            lambda d: {"thinning": -d.sized(0.2, 1.0), "thinning_time": d.one_of(0.0, 3.0)},
        ),
        "valve_offset": ("valve", lambda d: {"valve_offset": d.sign() * d.sized(2e-3, 3e-2)}),
        "valve_asymmetry": ("valve", lambda d: {"valve_asymmetry": d.sign() * d.sized(0.02, 0.15)}),
        "valve_lag": (
            "valve",
            lambda d: {"valve_frequency": 1 / d.sized(1.2e-3, 8e-3), "valve_damping": d.evenly(0.6, 1.0)},
        ),
        "input_delay": ("valve", lambda d: {"delay": d.sized(1e-3, 9e-3)}),
        "valve_hysteresis": ("valve", lambda d: {"hysteresis": d.sized(2.5e-3, 3e-2)}),
        "valve_saturation": ("valve", lambda d: {"limit": 0.9 - d.sized(0.1, 0.6)}),
    },
    {
        "dwell_friction": ("force", lambda d: {"dwell_gain": d.sized(0.4, 2.0)}),
        "flow_force": ("valve", lambda d: {"flow_force": d.sized(0.15, 0.8)}),
        "spool_stiction": ("valve", lambda d: {"stiction": d.sized(5e-3, 4e-2)}),
        "relief_valve": (
            "flow",
            lambda d: {"relief": d.sized(1e-6, 1e-5), "relief_pressure": d.evenly(5.5e6, 6.5e6)},
        ),
        "hose_creep": ("flow", lambda d: {"creep": d.sized(1e-13, 1e-12)}),
        "supply_pulsation": (
            "flow",
            lambda d: {"pulsation": d.sized(0.02, 0.15), "pulsation_frequency": d.between(3.0, 15.0)},
        ),
        "sensor_crosstalk": ("sensor", lambda d: {"crosstalk": d.sign() * d.sized(4e-4, 4e-3)}),
    },
)
BOARDS = {"rotary-axis": ROTARY, "servo-hydraulic": HYDRAULIC}
