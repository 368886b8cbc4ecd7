"""An effect of one's own: a seal rubs in proportion to the square root of the speed."""

from collections.abc import Mapping
from typing import Any

import optid
from optid.laws import signed_root

FORCE = optid.Parameter(
    "force", "N", 5.0, "seal's friction at 1 m/s", "seal maker's diagram: 2 to 20 N", 0.0, (-100.0, 100.0)
)


class RubbingSeal(optid.Effect):
    """The seal's friction is force sign(v) sqrt(|v|), smooth below 1 mm/s."""

    name = "rubbing_seal"
    sites = ("force.friction",)
    equation = "11"
    parameters = (FORCE,)
    strength = {"force": 0.5}  # below half a newton it is not worth a name
    usual = ({"force": 5.0}, {"force": 20.0})  # where a search begins
    law = "the seal's friction goes with the square root of the speed"
    says = "the seal rubs with {force} at 1 m/s, in proportion to the square root of the speed"
    depends_on = ("velocity",)
    needs = "slow and fast motion"
    look_alikes = ("stribeck_friction", "quadratic_drag")
    experiment = "strokes at 5, 50 and 500 mm/s"
    source = "seal maker's diagram"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: optid.Sheet) -> Any:
        """Friction force, N; the nominal one at force = 0."""
        return nominal + sheet.param(FORCE) * signed_root(near["v"], 1e-6)
