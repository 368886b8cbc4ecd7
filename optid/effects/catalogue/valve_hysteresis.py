"""A spool with hysteresis: it stops short of its command, from both sides."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.core.smooth import dead_zone
from optid.effects.effect import Effect
from optid.effects.parallel_elements import shares

WIDTH = Parameter(
    "width",
    "1",
    5e-3,
    "half the hysteresis, as a share of full command",
    "usual: 0.1 to 3 %",
    0.0,
    (0.0, 0.3),
)
SPREAD = Parameter(
    "spread",
    "1",
    0.3,
    "share by which the widest part of the hysteresis exceeds the mean and the narrowest falls short of it",
    # Inner loops of a solenoid's iron are narrower than the outer one.
    "six Prandtl-Ishlinskii play operators in parallel",
    0.0,
    (0.0, 1.0),
)
BEND = Parameter(
    "bend",
    "1",
    0.05,
    "by how much the widest part is wider than in an even spread, as a share of the mean",
    "widths are positive, so their distribution is skewed to the wide ones",
    0.0,
    (0.0, 0.5),
)
CATCH = 3e-4  # s: relaxation time of the play; its output is exact while it moves, at any value


class ValveHysteresis(Effect):
    """Six plays in parallel: each lags the command by its width and does not move while a reversal takes it up."""

    name = "valve_hysteresis"
    sites = ("valve.command",)
    equation = "3-6"
    parameters = (WIDTH, SPREAD, BEND)
    strength = {"width": 5e-4}
    usual = ({"width": 4e-3, "spread": 0.0, "bend": 0.0}, {"width": 0.02, "spread": 0.0, "bend": 0.0})
    law = (
        "the spool follows command - h when the command grows and command + h when it falls, with h from w (1 - "
        "s) to w (1 + s), skewed"
    )
    says = (
        "the valve has a hysteresis of {width} of full command to each side; its parts are narrower or wider by "
        "a share of up to {spread} (the widest by {bend} more)"
    )
    depends_on = ("command_rate", "command")
    needs = "reversals of the command"
    ahead_of = ("valve_offset", "valve_lag", "valve_rate_limit", "valve_saturation")
    look_alikes = ("valve_lag", "input_delay", "valve_deadband", "sensor_backlash", "sensor_lag")
    experiment = "triangles of the command at two rates: hysteresis does not depend on the rate, a lag does"
    source = "play (backlash) operator, as a relaxation with its own state"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """Position of the spool, a share of full travel."""
        width, spread, bend = sheet.param(WIDTH), sheet.param(SPREAD), sheet.param(BEND)
        stands, parts = 0.0, shares(spread, bend)
        for number, share in enumerate(parts, 1):
            memory = sheet.state(f"play_{number}", "1", 0.1, spread=0.3)
            beyond = dead_zone(nominal - memory, width * share)
            sheet.rate(memory, beyond / CATCH)
            stands = stands + (memory + beyond) / len(parts)
        return stands
