"""The one-step prediction of an identifier before the predicted sample is measured."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numba

from optid.armax.layout import HEADER, INPUTS, NA, NC, OUTPUTS, PAST_INPUTS, RESIDUALS, SCALE
from optid.core.model import Array

Kernel = TypeVar("Kernel", bound=Callable[..., object])
# Not cached: numba would not notice that the layout, which stands in another file, has changed.
quick: Callable[[Kernel], Kernel] = numba.njit


@quick
def predict_next(s: Array) -> float:
    """Output of the next sample, in the output's unit, from an identifier's packed memory (`optid.armax.layout`).

    For models of one input whose delay is at least one sample: the command of that sample is not known yet.
    """
    na, nc, m = int(s[NA]), int(s[NC]), int(s[INPUTS])
    nb, nk = int(s[HEADER]), int(s[HEADER + 1])
    theta = HEADER + 4 * m
    yh, eh, uh = int(s[OUTPUTS]), int(s[RESIDUALS]), int(s[PAST_INPUTS])
    total = 0.0
    for k in range(na):
        total += s[theta + k] * s[yh + k]
    for k in range(nb):
        total += s[theta + na + k] * s[uh + nk - 1 + k]
    for k in range(nc):
        total += s[theta + na + nb + k] * s[eh + k]
    return float(total * s[SCALE])
