"""A command as it was some time ago, between the samples that were recorded of it."""

from __future__ import annotations

import itertools
from typing import Any

import casadi as ca

from optid.core.sheet import Sheet

# Samples ago that are looked up: every one for short delays, fewer for long ones. A delay beyond the last counts
# as the last: 12 ms at 5 kHz, 64 ms at 1 kHz.
TAPS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 16, 24, 40, 64)


def command_ago(sheet: Sheet, nominal: Any, time: Any) -> Any:
    """The command of `time` seconds ago, as steps at the samples that move what is slower than a sample alike.

    A held command that changes inside a sample is replaced by one that changes at samples only, with the same mean,
    mean time and spread in time: Lagrange's cubic through four held values (Laakso and others, "Splitting the unit
    delay", IEEE Signal Processing Magazine 13, 1996). A straight line between two of them has the mean and the mean
    time alone and moves an axis wrongly by up to three times as much; beyond ten samples it is one.

    Args:
        sheet: of a plant with an input "command".
        nominal: the command now.
        time: s; its slope at 0 is that of the right side.
    """
    ago = time / sheet.interval()
    held = [nominal, *(sheet.past("command", k) for k in TAPS[1:])]
    late = nominal
    for k, (left, right) in enumerate(itertools.pairwise(TAPS)):
        way = (ago - left) / (right - left)
        # Without a floor at 0 for the first, so that the slope at the null is that of the right side.
        share = ca.fmin(way if k == 0 else ca.fmax(way, 0), 1)
        late = late + share * (held[k + 1] - held[k])
        if k + 2 < len(TAPS) and TAPS[k + 2] - left == 2:  # Everett's form: what a cubic has beyond the line
            after = held[k + 2] - 2 * held[k + 1] + held[k]
            before = held[k + 1] - 2 * held[k] + held[k - 1] if k else after
            bend = share * (share - 1)
            late = late + bend / 4 * (before + after) + bend * (share - 0.5) / 6 * (after - before)
    return late
