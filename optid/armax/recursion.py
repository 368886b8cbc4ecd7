"""One sample of recursive ARMAX identification over one packed array; compiled by numba, and translated to C.

The algorithm is Ljung and Söderström's recursive prediction-error method (Theory and Practice of Recursive
Identification, MIT Press 1983, ch. 3; Söderström and Stoica, System Identification, 1989, ch. 9):

    e(t)     = y(t) - phi(t)' theta(t-1)                      innovation
    psi(t)   = phi(t) / C(q)                                  (extended least squares: psi = phi)
    K(t)     = P psi / (lambda + psi' P psi)
    theta(t) = theta(t-1) + K e,   C(q) then brought back to stability
    P(t)     = (P - K psi' P) / lambda
    residual = y(t) - phi(t)' theta(t), which enters phi(t+1) in the place of the unknown noise

P is kept as U D U' and updated by Bierman's algorithm (Factorization Methods for Discrete Sequential
Estimation, 1977, ch. V), here written with beta = 1 + w psi' P psi so that the weight w of a sample may be
zero or, for directional forgetting, negative. D stays positive whatever the data, and so P positive definite;
updating P itself loses symmetry and then positivity.

All kernels stand in this one file because numba's cache looks at the file of the outermost function alone.
They keep to a small language (floats, whole numbers, ranges, parts of one array) because
`optid.armax.translate` writes the same functions in C.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeVar

import numba

from optid.armax.layout import (
    BOUNDED,
    EASE,
    EASE_RATE,
    FACTOR,
    FILTERED,
    FORGETTING,
    HEADER,
    HOLD,
    INPUTS,
    LIMIT,
    MEMORY,
    MISSING,
    NA,
    NC,
    OUTLIER,
    PARAMETERS,
    PREDICTION,
    PROJECTED,
    RADIUS,
    SAMPLES,
    SCALE,
    SLOW,
    SQUARES,
    TRACE,
    UPDATES,
    WARM,
    WARM_RATE,
    WEIGHT,
)
from optid.core.model import Array

LARGEST_SIGNAL = 1e30  # in scales of the signal; what is larger counts as missing
LARGEST_PARAMETER = 1e60
LARGEST_NEWS = 1e200  # psi' P psi above which a sample teaches nothing but overflow
SMALLEST_NEWS = 1e-30  # psi' P psi below which a direction is not forgotten
SMALLEST_VARIANCE = 1e-200  # of D: far below anything data can reach, far above underflow
RETRACE = 256  # updates between two exact computations of the trace of P

Kernel = TypeVar("Kernel", bound=Callable[..., object])
_OPTIONS = {"cache": True, "error_model": "numpy", "nogil": True}
# Without reference counts on the parts of the array: they would cost three times the arithmetic.
compiled: Callable[[Kernel], Kernel] = numba.njit(_nrt=False, **_OPTIONS)
folded: Callable[[Kernel], Kernel] = numba.njit(_nrt=False, inline="always", **_OPTIONS)


@folded
def project(U: Array, D: Array, psi: Array, F: Array, n: int) -> float:
    """F = U' psi; returns psi' P psi."""
    news = 0.0
    for j in range(n):
        f = psi[j]
        k = j * n
        for i in range(j):
            f += U[k + i] * psi[i]
        F[j] = f
        news += f * f * D[j]
    return news


@folded
def update(U: Array, D: Array, F: Array, G: Array, n: int, w: float, forget: float) -> float:
    """P <- (P - w G G' / (1 + w psi' P psi)) / forget, G = P psi, from F = U' psi; returns the trace lost."""
    beta = 1.0
    inverse = 1.0
    fade = 1.0 / forget
    for j in range(n):
        f = F[j]
        d = D[j]
        v = d * f
        share = -w * f * inverse
        grown = beta + w * f * v
        inverse = 1.0 / grown
        d = d * beta * inverse * fade
        if not d > SMALLEST_VARIANCE:
            d = SMALLEST_VARIANCE
        D[j] = d
        k = j * n
        for i in range(j):
            old = U[k + i]
            g = G[i]
            U[k + i] = old + share * g
            G[i] = g + v * old
        G[j] = v
        beta = grown
    square = 0.0
    for j in range(n):
        square += G[j] * G[j]
    return w * square * inverse


@compiled
def trace_of(U: Array, D: Array, n: int) -> float:
    """The trace of U D U'."""
    total = 0.0
    for j in range(n):
        length = 1.0
        k = j * n
        for i in range(j):
            length += U[k + i] * U[k + i]
        total += D[j] * length
    return total


@compiled
def roots_inside(c: Array, order: int, radius: float, work: Array) -> float:
    """1 if every root of z^order + c[0] z^(order-1) + ... lies inside the radius, else 0 (Schur and Cohn).

    Steps down from order to 0: each reflection coefficient must be smaller than 1.
    """
    total = 0.0
    factor = 1.0
    inverse = 1.0 / radius
    for i in range(order):
        factor = factor * inverse
        work[i] = c[i] * factor
        total += abs(work[i])
    if total < 1.0:
        return 1.0
    for down in range(order):
        k = order - down
        last = work[k - 1]
        if not abs(last) < 1.0:
            return 0.0
        for i in range(k - 1):
            work[order + i] = (work[i] - last * work[k - 2 - i]) / (1.0 - last * last)
        for i in range(k - 1):
            work[i] = work[order + i]
    return 1.0


@compiled
def stabilise(c: Array, order: int, radius: float, work: Array) -> float:
    """Draw the roots of C radially inwards until all lie inside the radius; returns 1 if it had to."""
    if roots_inside(c, order, radius, work) > 0.0:
        return 0.0
    for _ in range(100):
        factor = 1.0
        for i in range(order):
            factor = factor * 0.95
            c[i] = c[i] * factor
        if roots_inside(c, order, radius, work) > 0.0:
            return 1.0
    for i in range(order):
        c[i] = 0.0
    return 1.0


@folded
def filtered(x: float, c: Array, past: Array, order: int, share: float) -> float:
    """x(t) / C(q), given its own past; share < 1 draws the roots of C towards the origin."""
    factor = 1.0
    for i in range(order):
        factor = factor * share
        x -= factor * c[i] * past[i]
    if not abs(x) < LARGEST_SIGNAL:
        return 0.0
    return x


@folded
def newest(past: Array, first: int, length: int) -> float:
    """The last measured value at or before an entry: a lost command is taken to hold."""
    x = 0.0
    for back in range(length - first):
        value = past[length - 1 - back]
        if abs(value) < LARGEST_SIGNAL:
            x = value
    return x


@folded
def push(past: Array, length: int, x: float) -> float:
    """The newest value moves in front."""
    for back in range(1, length):
        i = length - back
        past[i] = past[i - 1]
    if length > 0:
        past[0] = x
    return 0.0


@compiled
def advance(s: Array, y: float) -> float:
    """Take one sample whose inputs stand in `now`; returns the innovation, NaN for a missing output."""
    na = int(s[NA])
    nc = int(s[NC])
    n = int(s[PARAMETERS])
    m = int(s[INPUTS])
    nf = nc
    if na > nc:
        nf = na
    at = HEADER
    table = s[at : at + 3 * m]
    at += 3 * m
    now = s[at : at + m]
    at += m
    theta = s[at : at + n]
    c = s[at + n - nc : at + n]
    at += n
    D = s[at : at + n]
    at += n
    U = s[at : at + n * n]
    at += n * n
    phi = s[at : at + n]
    at += n
    psi = s[at : at + n]
    at += n
    F = s[at : at + n]
    at += n
    G = s[at : at + n]
    at += n
    work = s[at : at + 2 * nc]
    at += 2 * nc
    eh = s[at : at + nc]
    at += nc
    ef = s[at : at + nc]
    at += nc
    yh = s[at : at + na]
    at += na
    yf = s[at : at + nf]
    at += nf
    likelihood = s[FILTERED] > 0.0
    share = 1.0 - s[EASE]
    hold = s[HOLD]
    s[SAMPLES] += 1.0

    # The regressor and its gradient.
    for k in range(na):
        phi[k] = -yh[k]
        psi[k] = -yf[k]
    column = na
    for i in range(m):
        nb = int(table[3 * i])
        nk = int(table[3 * i + 1])
        length = nb + nk
        flength = length
        if nc > length:
            flength = nc
        uh = s[at : at + length]
        at += length
        uf = s[at : at + flength]
        at += flength
        x = now[i] * table[3 * i + 2]
        if abs(x) < LARGEST_SIGNAL:
            push(uh, length, x)
        else:
            push(uh, length, math.nan)
            x = newest(uh, 0, length)
            s[MISSING] += 1.0
        if likelihood:
            push(uf, flength, filtered(x, c, uf, nc, share))
        for k in range(nb):
            x = uh[nk + k]
            if not abs(x) < LARGEST_SIGNAL:
                x = newest(uh, nk + k, length)
                if hold < 1.0:
                    hold = 1.0
            phi[column + k] = x
            psi[column + k] = uf[nk + k]
        column += nb
    for k in range(nc):
        phi[column + k] = eh[k]
        psi[column + k] = ef[k]
    if not likelihood:
        for k in range(n):
            psi[k] = phi[k]

    prediction = 0.0
    for k in range(n):
        prediction += phi[k] * theta[k]
    if not abs(prediction) < LARGEST_PARAMETER * LARGEST_SIGNAL:
        prediction = 0.0
    s[PREDICTION] = prediction
    measured = y / s[SCALE]
    seen = abs(measured) < LARGEST_SIGNAL
    residual = 0.0
    if not seen:
        s[MISSING] += 1.0
        measured = prediction
        if not abs(measured) < LARGEST_SIGNAL:
            measured = 0.0
        if hold < na + 1.0:
            hold = na + 1.0
    e = measured - prediction

    if hold > 0.0:
        # After a gap the residuals start again from zero, the filtered output as if it had been constant.
        hold -= 1.0
        dc = 1.0
        factor = 1.0
        for k in range(nc):
            factor = factor * share
            dc += factor * c[k]
        for k in range(nf):
            yf[k] = measured / dc
    else:
        news = project(U, D, psi, F, n)
        if news < LARGEST_NEWS:
            learn(s, theta, U, D, F, G, n, e, news)
            if nc > 0:
                s[PROJECTED] += stabilise(c, nc, s[RADIUS], work)
        residual = measured
        for k in range(n):
            residual -= phi[k] * theta[k]
        bound = s[OUTLIER]
        if bound > 0.0 and s[UPDATES] > 2.0 * n + 10.0:
            bound = bound * math.sqrt(s[SQUARES] / s[WEIGHT])
            if residual > bound:
                residual = bound
            if residual < -bound:
                residual = -bound
    s[HOLD] = hold
    if not abs(residual) < LARGEST_SIGNAL:
        residual = 0.0

    push(yh, na, measured)
    push(eh, nc, residual)
    if likelihood:
        push(yf, nf, filtered(measured, c, yf, nc, share))
        push(ef, nc, filtered(residual, c, ef, nc, share))
    if not seen:
        return math.nan
    innovation: float = e * s[SCALE]
    return innovation


@folded
def learn(
    s: Array, theta: Array, U: Array, D: Array, F: Array, G: Array, n: int, e: float, news: float
) -> float:
    """Move theta and P by one innovation."""
    updates = s[UPDATES]
    s[UPDATES] = updates + 1.0

    # An outlier counts with Huber's weight: its step is that of an innovation at the bound.
    weight = 1.0
    if s[OUTLIER] > 0.0 and updates > 2.0 * n + 10.0:
        bound = s[OUTLIER] * math.sqrt(s[SQUARES] / s[WEIGHT])
        if abs(e) > bound:
            weight = bound / abs(e)
            s[BOUNDED] += 1.0

    # How much to forget. Fortescue, Kershenbaum and Ydstie (Automatica 17, 1981) for the variable factor.
    forget = s[FACTOR]
    if s[MEMORY] > 0.0:
        forget = 1.0
        if s[SLOW] > 0.0:
            forget = 1.0 - weight * e * e / ((1.0 + news) * s[MEMORY] * s[SLOW])
        if forget < s[FACTOR]:
            forget = s[FACTOR]
        if updates >= n and news * s[MEMORY] > 1.5:  # at rest errors say nothing about their usual size
            span = 0.25 * (updates - n) + 1.0  # early, and large, errors fade from the average
            if span > 10.0 * s[MEMORY]:
                span = 10.0 * s[MEMORY]
            s[SLOW] += (weight * e * e / (1.0 + news) - s[SLOW]) / span
    elif s[FORGETTING] == 0.0:
        # A sample that brings less news than forgetting costs is no reason to forget: at rest nothing fades.
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
    least = s[TRACE] / s[LIMIT]
    if least > 1.0:
        least = 1.0
    if forget < least:
        forget = least

    if s[FORGETTING] > 0.0 and s[WARM] == 0.0:
        # Only the direction of psi forgets (Kulhavý and Kárný, IFAC World Congress 1984).
        w = weight * forget
        if news > SMALLEST_NEWS:
            w = w - (1.0 - forget) / news
        loss = update(U, D, F, G, n, w, 1.0)
        gain = weight * e / (1.0 + weight * news)
        s[TRACE] = s[TRACE] - loss
    else:
        loss = update(U, D, F, G, n, weight / forget, forget)
        gain = weight * e / (forget + weight * news)
        s[TRACE] = (s[TRACE] - loss) / forget
    count = int(s[UPDATES])
    if count % RETRACE == 0:
        s[TRACE] = trace_of(U, D, n)

    largest = 0.0
    for k in range(n):
        if not abs(theta[k] + gain * G[k]) < LARGEST_PARAMETER:
            largest = 1.0
    if largest == 0.0:
        for k in range(n):
            theta[k] += gain * G[k]

    # Innovation times residual: at forget = 1 its sum is the residual sum of squares.
    s[WEIGHT] = forget * s[WEIGHT] + 1.0
    s[SQUARES] = forget * (s[SQUARES] + weight * weight * e * e / (forget + weight * news))
    return 0.0


@compiled
def step_single(s: Array, y: float, u: float) -> float:
    """One sample of a model with one input."""
    s[HEADER + 3] = u
    return advance(s, y)


@compiled
def step_many(s: Array, y: float, u: Array) -> float:
    """One sample of a model with any number of inputs."""
    m = int(s[INPUTS])
    for i in range(m):
        s[HEADER + 3 * m + i] = u[i]
    return advance(s, y)


@compiled
def run(s: Array, y: Array, u: Array, innovations: Array, track: Array, every: int) -> None:
    """A whole recording: y (N,), u (N, m); fills innovations (N,) and every so often a row of `track`."""
    m = int(s[INPUTS])
    n = int(s[PARAMETERS])
    for t in range(y.size):
        for i in range(m):
            s[HEADER + 3 * m + i] = u[t, i]
        innovations[t] = advance(s, y[t])
        if every > 0 and t % every == every - 1:
            for k in range(n):
                track[t // every, k] = s[HEADER + 4 * m + k]
