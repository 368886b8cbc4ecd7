"""A load on an elastic coupling to the piston: a belt, a bracket, a long rod."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

SHARE = Parameter(
    "load_share",
    "1",
    0.4,
    "share of the moving mass behind the elastic coupling",
    "nothing to nearly all",
    0.0,
    (0.0, 0.9),
)
FREQUENCY = Parameter(
    "frequency",
    "Hz",
    30.0,
    "natural frequency of the load on its coupling, with the piston held",
    "usual: 10 to 100 Hz",
    30.0,
    (2.0, 120.0),
    logarithmic=True,
)
DAMPING = Parameter(
    "damping_ratio",
    "1",
    0.1,
    "damping ratio of the load on its coupling",
    "bolted joints 0.01, rubber 0.2",
    0.1,
    (5e-3, 0.5),
    logarithmic=True,
)


class CompliantLoad(Effect):
    """Two masses, (1 - share) M with piston and sensor and share M on a spring and a damper."""

    name = "compliant_load"
    sites = ("force.acceleration",)
    equation = "11"
    parameters = (SHARE, FREQUENCY, DAMPING)
    strength = {"load_share": 0.08}
    usual = tuple({"load_share": 0.5, "frequency": f, "damping_ratio": 0.1} for f in (8.0, 16.0, 32.0, 64.0))
    law = "(1 - share) M x'' = forces + k y + c y', y'' + 2 z w y' + w^2 y = -x'', k = share M w^2"
    says = (
        "{load_share} of the moving mass hangs on an elastic coupling and swings at {frequency} "
        "(damping ratio {damping_ratio})"
    )
    depends_on = ("acceleration",)
    needs = "quick changes of the command that make the load swing"
    excludes = ("transmission_backlash", "transmission_compliance")
    look_alikes = ("sensor_backlash", "valve_lag", "sensor_lag", "input_delay")
    experiment = "an accelerometer on the load, or small steps of the command at 20 to 100 Hz"
    source = "Newton's second law for two masses"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """Acceleration of the piston, m/s2."""
        share, w = sheet.param(SHARE), 2 * math.pi * sheet.param(FREQUENCY)
        y = sheet.state("stretch", "m", 1e-3, spread=5e-4)
        # Of the load itself: the stretch would contain the piston's friction, and need as fine an integration.
        speed = sheet.state("load_speed", "m/s", 0.1, spread=0.2)
        rate = speed - near["v"]
        pull = w * w * y + 2 * sheet.param(DAMPING) * w * rate  # of the coupling, per mass of the load
        sheet.rate(y, rate)
        sheet.rate(speed, -pull)
        return (near["net"] + share * near["mass"] * pull) / ((1 - share) * near["mass"])
