"""A signal that holds until its input has moved by a width, and then follows at once: a surrogate for what sticks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.description import OWN, POSITIVE, Description, constant

WIDTHS = np.geomspace(0.02, 1.0, 28)  # of the usual size: where searches begin, as jumps tell no slope
LOOSE, BACK = 4e-5, 8e-5  # s: in which it comes loose, and in which it then goes
NEAR, SHARP = 2e-3, 5e-4  # of the width: how near it comes before it stays again, how sharply either is told
SURE = 0.03  # of being loose: how sharply that is told
NULL = 1e-6  # of the usual size: as good as nothing


class Sticking(Description):
    """z in place of the signal u: z' = l (u - z) / BACK, with l from 0 to 1 where |u - z| > width until z is near u.

    Args:
        site: whose signal sticks.
        signal: what sends it, for the name alone: the site's own signal counts.
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
        """Where the signal stands."""
        size, share = (sheet.param(q) for q in self.parameters)
        width = size * share
        # It begins loose, so that it is at once where it is sent.
        stands, loose = (
            sheet.state("stands", "1", 0.1, spread=0.1),
            sheet.state("loose", "1", 0.3, start=1.0, spread=1e-3),
        )
        off = nominal - stands
        gone, there = ca.fabs(off) / width - 1, NEAR - ca.fabs(off) / width
        released, arrived = _step(gone / SHARP), _step(there / SHARP)
        # It moves only once it is sure to go on.
        moving, going = _step((loose - 0.5) / SURE), _step((loose - 0.75) / SURE)
        # A latch: what moves goes on until it has arrived, what stays does so until it is released.
        goes = 1 - (1 - released) * (1 - moving * (1 - arrived))
        sheet.rate(loose, (goes - loose) / LOOSE)
        sheet.rate(stands, going * off / BACK)
        return stands


def _step(value: Any) -> Any:
    """From 0 to 1 as a value changes its sign."""
    return 0.5 * (1 + ca.tanh(value / 2))
