"""A signal that holds until its input has moved by a width, and then follows at once: a surrogate for sticking."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.description import OWN, POSITIVE, Description, constant

WIDTHS = np.geomspace(0.02, 1.0, 28)  # of the usual size: start values of searches, as jumps give no slope
LOOSE, BACK = 4e-5, 8e-5  # s: time constants of its release and of its motion
NEAR, SHARP = 2e-3, 5e-4  # of the width: distance at which it sticks again, and sharpness of both switches
SURE = 0.03  # of the latch: sharpness of its switch
NULL = 1e-6  # of the usual size: practically zero


class Sticking(Description):
    """z in place of the signal u: z' = l (u - z) / BACK, with l from 0 to 1 where |u - z| > width until z is near u.

    Args:
        site: whose signal sticks.
        signal: its input, used in the name only: the site's own signal is used.
        size: usual size of the signal, in its SI unit.

    Source: a valve that sticks and jumps, as Choudhury, Thornhill and Shah, Control Engineering Practice 13(5), 2005.
    """

    kind = "sticking"
    adds = False
    needs = "slow changes with reversals"

    def __init__(self, site: str, signal: str, *, size: float = 1.0) -> None:
        super().__init__(site, signal, magnitude=1.0, size=size)
        self.parameters = (
            constant("size", size, POSITIVE, "usual magnitude of the sticking quantity, in its SI unit"),
            Parameter(
                "width",
                "1",
                0.1,
                "how far the signal moves before it jumps, as a share of the usual size",
                OWN,
                NULL,
                (NULL, 10.0),
                logarithmic=True,
            ),
        )
        self.strength = {"width": float(WIDTHS[0])}
        self.usual = tuple({"width": float(width)} for width in WIDTHS)
        self.law = (
            f"a value that stays until {self.along.replace('_', ' ')} has moved a certain distance, and then "
            "jumps to it"
        )
        self.says = f"{self.law} ({{width}} of its usual size){self.describes}"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The present value of the signal."""
        size, share = (sheet.param(q) for q in self.parameters)
        width = size * share
        # It begins released, so that it reaches its input at once.
        stands, loose = (
            sheet.state("stands", "1", 0.1, spread=0.1),
            sheet.state("loose", "1", 0.3, spread=1e-3),
        )
        off = nominal - stands
        gone, there = ca.fabs(off) / width - 1, NEAR - ca.fabs(off) / width
        released, arrived = _step(gone / SHARP), _step(there / SHARP)
        # It moves only once it is certain to continue.
        moving, going = _step((loose - 0.5) / SURE), _step((loose - 0.75) / SURE)
        # A latch: a moving signal continues until it has arrived, a sticking one stays until it is released.
        goes = 1 - (1 - released) * (1 - moving * (1 - arrived))
        sheet.rate(loose, (goes - loose) / LOOSE)
        sheet.rate(stands, going * off / BACK)
        return stands


def _step(value: Any) -> Any:
    """From 0 to 1 as a value changes its sign."""
    return 0.5 * (1 + ca.tanh(value / 2))
