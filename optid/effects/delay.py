"""A delayed command: where the delay is not a multiple of the sampling interval, it switches inside a hold."""

from __future__ import annotations

import itertools
from typing import Any

import casadi as ca

from optid.core.sheet import Sheet

# Delays in samples that are looked up: every one for short delays, fewer for long ones. A longer delay counts as the
# last: 12 ms at 5 kHz, 64 ms at 1 kHz.
TAPS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 16, 24, 40, 64)


def input_ago(sheet: Sheet, nominal: Any, time: Any, role: str = "command") -> Any:
    """An input delayed by `time` seconds, in addition to other effects' delays; their other changes are kept.

    Up to twelve samples it is exact: the integrator takes each hold in two halves, before and after the switch, whose
    lengths have slopes. Their mean would move an axis wrongly, because a command that changes sign opens other ports
    than its mean. Longer delays are interpolated linearly between the samples that are looked up.

    Args:
        sheet: of the plant.
        nominal: the input now.
        time: delay, s; its slope at 0 is the right-hand one.
        role: of the input.
    """
    before, now = sheet.delay_input(time)
    known = sheet.past(role, 0) if before is None else _held(sheet, role, before)
    return nominal - known + _held(sheet, role, now)


def _held(sheet: Sheet, role: str, time: Any) -> Any:
    ago = time / sheet.interval()
    held = [sheet.past(role, k) for k in TAPS]
    first, then, share = held[1], held[0], ago  # of a hold: in this order at no delay, too
    for k, (left, right) in enumerate(itertools.pairwise(TAPS)):
        change = held[k + 1] - held[k]
        if right - left == 1:
            first = first + (ago >= left) * change if left else first
            then, share = then + (ago >= right) * change, share - (ago >= right)
        else:
            way = ca.fmin(ca.fmax((ago - left) / (right - left), 0), 1) * change
            first, then = first + way, then + way
    return sheet.switch_within_hold(ca.fmin(share, 1), first, then)
