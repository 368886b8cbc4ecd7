"""Past samples: newest first, each in front of the one before it."""

from __future__ import annotations

from optid.armax.compiling import inline_jit
from optid.armax.ud_simd import inner
from optid.core.model import Array

LARGEST_SIGNAL = 1e30  # in scales of the signal; a larger value counts as missing


@inline_jit
def filtered(x: float, c: Array, past: Array, order: int, share: float) -> float:
    """x(t) / C(q), given its own past; share < 1 draws the roots of C towards the origin."""
    known = 0.0  # summed before x is added, for a short dependency chain
    if share == 1.0:
        known = inner(c, past, order)
    else:
        factor = 1.0
        for i in range(order):
            factor = factor * share
            known += factor * c[i] * past[i]
    x = x - known
    if not abs(x) < LARGEST_SIGNAL:
        return 0.0
    return x


@inline_jit
def newest(past: Array, first: int, length: int) -> float:
    """The last measured value at or before an entry: a lost command is assumed to hold."""
    x = 0.0
    for back in range(length - first):
        value = past[length - 1 - back]
        if abs(value) < LARGEST_SIGNAL:
            x = value
    return x
