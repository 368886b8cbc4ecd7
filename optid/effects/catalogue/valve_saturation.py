"""A spool or port that opens less than commanded beyond some opening."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.core.smooth import dead_zone
from optid.effects.effect import Effect

LOSS = Parameter(
    "loss",
    "1",
    0.5,
    "share of the command beyond the limit that is lost; 1 is a hard stop",
    "from nothing to all of it",
    0.0,
    (0.0, 1.0),
)
LIMIT = Parameter(
    "limit",
    "1",
    0.5,
    "share of full command beyond which the spool saturates",
    "usual: 60 to 100 %",
    0.7,
    (0.02, 1.5),
)
SKEW = Parameter(
    "skew",
    "1",
    0.05,
    "share by which the limit is larger for positive and smaller for negative commands",
    "each end of the spool's travel has its own stop",
    0.0,
    (-0.5, 0.5),
)


class ValveSaturation(Effect):
    """A bend in the valve's characteristic, up to a hard stop."""

    name = "valve_saturation"
    sites = ("valve.command",)
    equation = "3-6"
    parameters = (LOSS, LIMIT, SKEW)
    strength = {"loss": 0.1}
    usual = tuple({"loss": 0.8, "limit": limit, "skew": 0.0} for limit in (0.3, 0.55, 0.8))
    law = "beyond limit (1 + skew) and -limit (1 - skew) the spool follows only (1 - loss) of the command"
    says = (
        "beyond {limit} of full command the valve opens less than commanded: {loss} of the rest is lost (the "
        "limit is larger by a share of {skew} forwards, and smaller by it backwards)"
    )
    depends_on = ("command",)
    needs = "commands beyond the limit, steps up to full command"
    look_alikes = ("tube_restriction", "supply_droop", "valve_rate_limit", "quadratic_drag")
    experiment = "apply one frequency at rising amplitude: a stop clips, a narrow tube rounds"
    source = "limited travel of spool and port"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """Command that the spool follows, a share of full command."""
        limit, skew = sheet.param(LIMIT), sheet.param(SKEW)
        return nominal - sheet.param(LOSS) * dead_zone(nominal - limit * skew, limit)
