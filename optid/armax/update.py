"""The update by one innovation: its weight, the forgetting, and the update of theta and P."""

from __future__ import annotations

import math

from optid.armax.compiling import inline_jit, jit
from optid.armax.layout import (
    BOUNDED,
    EASE,
    EASE_RATE,
    FACTOR,
    FADE,
    FORGETTING,
    HEADER,
    LIMIT,
    MEMORY,
    OUTLIER,
    SLOW,
    SQUARES,
    TRACE,
    UPDATES,
    WARM,
    WARM_RATE,
    WEIGHT,
    Shape,
)
from optid.armax.ud_simd import inner, move, part, sweep, weigh
from optid.core.model import Array

LARGEST_STEP = 1e100  # squared length of a step of theta; a larger one is rejected
SMALLEST_NEWS = 1e-30  # psi' P psi below which a direction is not forgotten
QUIET = 0.02  # share of the usual information below which a sample counts as rest
RETRACE = 256  # updates between two exact computations of the trace of P


@jit
def trace_of(U: Array, D: Array, size: int) -> float:
    """The trace of U D U'."""
    total = 0.0
    for j in range(size):
        length = 0.0
        for i in range(j + 1):
            length += U[j * size + i] * U[j * size + i]
        total += D[j] * length
    return total


@inline_jit
def weight_of(s: Array, n: int, e: float) -> float:
    """Huber's weight of an outlier: its step is that of an innovation at the bound."""
    if s[OUTLIER] > 0.0 and s[UPDATES] > 2.0 * n + 10.0:
        bound = s[OUTLIER] * math.sqrt(s[SQUARES] / s[WEIGHT])
        if abs(e) > bound:
            s[BOUNDED] += 1.0
            weight: float = bound / abs(e)
            return weight
    return 1.0


@inline_jit
def forget_of(s: Array, n: int, e: float, weight: float, news: float) -> float:
    """The forgetting factor at this sample."""
    updates = s[UPDATES]
    forget: float = s[FACTOR]
    if s[MEMORY] > 0.0:  # Fortescue, Kershenbaum and Ydstie, Automatica 17 (1981)
        forget = 1.0
        if s[SLOW] > 0.0:
            forget = 1.0 - weight * e * e / ((1.0 + news) * s[MEMORY] * s[SLOW])
        if forget < s[FACTOR]:
            forget = s[FACTOR]
        if updates >= n and news * s[MEMORY] > 1.5:  # errors at rest give no information on their usual size
            span = 0.25 * (updates - n) + 1.0  # early and large errors decay from the average
            if span > 10.0 * s[MEMORY]:
                span = 10.0 * s[MEMORY]
            s[SLOW] += (weight * e * e / (1.0 + news) - s[SLOW]) / span
    elif s[FORGETTING] == 0.0:
        # A sample with less information than forgetting removes does not cause forgetting: none at rest.
        worth = 1.5
        if n < 3:
            worth = 0.5 * n
        if news < worth * (1.0 - forget):
            forget = 1.0
    if s[WARM] > 0.0:
        forget = forget * (1.0 - s[WARM])
        s[WARM] = s[WARM] * s[WARM_RATE]
        if s[WARM] < 1e-12:
            s[WARM] = 0.0
    if s[EASE] > 0.0:
        s[EASE] = s[EASE] * s[EASE_RATE]
        if s[EASE] < 1e-12:
            s[EASE] = 0.0
    # Wind-up: P/forget never has a trace above the limit.
    if s[TRACE] > forget * s[LIMIT]:
        forget = s[TRACE] / s[LIMIT]
        if forget > 1.0:
            forget = 1.0
    return forget


@inline_jit
def learn(s: Array, shape: Shape, e: float, news: float) -> float:
    """Update theta and P by one innovation; returns the multiple of G that was added to theta."""
    n = shape.n
    size = shape.size
    at = HEADER + 4 * shape.m
    theta = part(s, at)
    D = part(s, at + size)
    F = part(s, at + 4 * size)
    V = part(s, at + 5 * size)
    G = part(s, at + 6 * size)
    U = part(s, at + 7 * size)
    weight = weight_of(s, n, e)
    forget = forget_of(s, n, e, weight, news)
    s[UPDATES] += 1.0
    fade = s[FADE]  # divided out of the way of what waits for it
    if forget != s[FACTOR]:
        fade = 1.0 / forget
    share = weight * fade
    step = e * (share / (1.0 + share * news))
    if s[FORGETTING] > 0.0 and s[WARM] == 0.0:
        # Only the direction of psi forgets (Kulhavý and Kárný, IFAC World Congress 1984).
        step = e * (weight / (1.0 + weight * news))
        share = weight * forget
        if news > SMALLEST_NEWS:
            share = share - (1.0 - forget) / news
        fade = 1.0
    beta = weigh(D, F, V, size, share, fade)
    for k in range(n, size):
        D[k] = 0.0
    sweep(U, V, F, G, size)
    square = inner(G, G, size)
    s[TRACE] = (s[TRACE] - share * square / beta) * fade
    count = int(s[UPDATES])
    if count % RETRACE == 0:
        s[TRACE] = trace_of(U, D, size)

    # Innovation times residual: at forget = 1 its sum is the residual sum of squares. At rest a sensor's last digit
    # is constant, which gives no information on the noise: such samples have far less information than usual.
    if s[WEIGHT] < 2.0 * n or news * s[WEIGHT] > QUIET * n:
        s[WEIGHT] = forget * s[WEIGHT] + 1.0
        s[SQUARES] = forget * (s[SQUARES] + weight * e * step)
    if not step * step * square < LARGEST_STEP:
        return 0.0
    move(theta, G, step, size)
    moved: float = step
    return moved
