"""A force that swings by itself: an unbalanced fan, a compressor, a neighbouring machine."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

AMPLITUDE = Parameter(
    "amplitude", "N", 3.0, "amplitude of the force", "physics catalogue A.1: 1 to 30 N", 0.0, (-1e3, 1e3)
)
FREQUENCY = Parameter(
    "frequency", "Hz", 3.0, "frequency of the force", "physics catalogue A.1: 0.2 to 30 Hz", 3.0, (0.05, 200.0),
    logarithmic=True,
)  # fmt: skip


class PeriodicDisturbance(Effect):
    """A sin(2 pi f t + phase); the phase is a state that stands still, so that every recording has its own."""

    name = "periodic_disturbance"
    sites = ("force.external",)
    equation = "11"
    parameters = (AMPLITUDE, FREQUENCY)
    strength = {"amplitude": 0.6}
    usual = tuple({"amplitude": 4.0, "frequency": f} for f in (0.4, 0.8, 1.6, 3.2, 6.4, 12.0, 24.0))
    law = "a force A sin(2 pi f t + phase)"
    says = "a force of {amplitude} swings at {frequency}, whatever the axis does"
    depends_on = ("time",)
    needs = "several of its periods"
    look_alikes = ("constant_force", "friction_drift")
    experiment = "change the rhythm of the reference: a line in the spectrum that stays is not the axis's own"
    source = "physics catalogue A.1, row 9"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """External force, N."""
        phase = sheet.state("phase", "1", 0.3, spread=2.0)
        sheet.rate(phase, 0.0)
        turns = sheet.param(FREQUENCY) * sheet.clock()
        return nominal + sheet.param(AMPLITUDE) * ca.sin(2 * math.pi * turns + phase)
