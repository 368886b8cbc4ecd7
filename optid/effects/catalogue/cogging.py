"""A motor whose magnets pull towards its slots: a torque or force that repeats over the position."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

AMPLITUDE = Parameter(
    "amplitude",
    "N",
    3.0,
    "amplitude of the torque or force, at the output",
    "Jahns and Soong, IEEE Trans. Industrial Electronics 43(2), 1996: 1 to 10 % of the rated torque",
    0.0,
    (0.0, 1e3),
)
PER_TURN = Parameter(
    "per_turn",
    "1",
    12.0,
    "periods per turn of the motor: the least common multiple of poles and slots, or a part of it",
    "small servo motors have 4 to 84",
    12.0,
    (0.5, 200.0),
    logarithmic=True,
)
PHASE = Parameter("phase", "1", 1.0, "phase where the position is 0, rad", "any", 0.0, (-7.0, 7.0))
TRIED = (1, 2, 3, 4, 6, 8, 9, 10, 12, 14, 16, 18, 20, 24, 28, 30, 36, 42, 48)


class Cogging(Effect):
    """A sin(2 pi n x / turn + phase), with the travel per turn of the motor."""

    name = "cogging"
    sites = ("drive.effort",)
    equation = "motion"
    parameters = (AMPLITUDE, PER_TURN, PHASE)
    strength = {"amplitude": 0.4}
    usual = tuple(
        {"amplitude": 3.0, "per_turn": float(n), "phase": quarter * math.pi / 2}
        for n in TRIED
        for quarter in (-1, 0, 1, 2)
    )
    law = "the drive's torque gains A sin(2 pi n x / turn + phase)"
    says = "the motor cogs: {amplitude}, {per_turn} times a turn (phase {phase} rad)"
    depends_on = ("position",)
    places = ("position",)
    needs = "slow motion over several of its periods"
    look_alikes = ("position_dependent_friction", "spring_load", "sensor_nonlinearity")
    experiment = "turn the axis slowly with the motor off, and watch the torque over the angle"
    source = "Jahns and Soong, IEEE Trans. Industrial Electronics 43(2), 1996"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The drive's effort at the output; the plant names the motor's travel "x" and that per turn "turn"."""
        turns = near["x"] / near["turn"]
        angle = 2 * math.pi * sheet.param(PER_TURN) * turns + sheet.param(PHASE)
        return nominal + sheet.param(AMPLITUDE) * ca.sin(angle)
