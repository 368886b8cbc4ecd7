"""A command as it was some time ago, between the samples that were recorded of it."""

from __future__ import annotations

from typing import Any

import casadi as ca

from optid.core.sheet import Sheet

# Samples ago that are looked up: every one for short delays, fewer for long ones. A delay beyond the last counts
# as the last: 12 ms at 5 kHz, 64 ms at 1 kHz.
TAPS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 16, 24, 40, 64)


def command_ago(sheet: Sheet, nominal: Any, time: Any) -> Any:
    """The mean over a sample of the command `time` seconds ago: straight lines between the held values.

    Args:
        sheet: of a plant with an input "command".
        nominal: the command now.
        time: s; its slope at 0 is that of the right side.
    """
    ago = time / sheet.interval()
    held = [nominal, *(sheet.past("command", k) for k in TAPS[1:])]
    late = nominal
    for k, left, right in zip(range(len(TAPS)), TAPS, TAPS[1:], strict=False):
        way = (ago - left) / (right - left)
        # Without a floor at 0 for the first, so that the slope at the null is that of the right side.
        share = ca.fmin(way if k == 0 else ca.fmax(way, 0), 1)
        late = late + share * (held[k + 1] - held[k])
    return late
