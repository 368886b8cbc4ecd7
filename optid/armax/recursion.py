"""One sample of recursive ARMAX identification over one packed array; compiled by numba, and translated to C.

The algorithm is Ljung and Söderström's recursive prediction-error method (Theory and Practice of Recursive
Identification, MIT Press 1983, ch. 3; Söderström and Stoica, System Identification, 1989, ch. 9):

    e(t)     = y(t) - phi(t)' theta(t-1)                      innovation
    psi(t)   = phi(t) / C(q)                                  (extended least squares: psi = phi)
    K(t)     = P psi / (lambda + psi' P psi)
    theta(t) = theta(t-1) + K e,   C(q) then brought back to stability
    P(t)     = (P - K psi' P) / lambda
    residual = y(t) - phi(t)' theta(t), which enters phi(t+1) in the place of the unknown noise

P is kept as U D U' and updated by Bierman's algorithm (`optid.armax.ud_factor`). D stays positive whatever the
data, and so P positive definite; updating P itself loses symmetry and then positivity.

The kernels keep to a small language (floats, whole numbers, ranges, parts of one array) because
`optid.core.translate` writes the same functions in C.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

from optid.armax.compiling import inline_jit, jit
from optid.armax.delay_line import LARGEST_SIGNAL, filtered, newest
from optid.armax.layout import (
    EASE,
    FILTERED,
    HEADER,
    HOLD,
    INPUTS,
    MISSING,
    NA,
    NC,
    OUTLIER,
    OUTPUTS,
    OUTPUTS_FILTERED,
    PARAMETERS,
    PAST_INPUTS,
    PATIENCE,
    PREDICTION,
    PROJECTED,
    RADIUS,
    RESIDUALS,
    RESIDUALS_FILTERED,
    SAMPLES,
    SCALE,
    SQUARES,
    STRIDE,
    UPDATES,
    WEIGHT,
    Shape,
)
from optid.armax.stability import roots_inside, stabilise
from optid.armax.ud_simd import copy, enter, inner, part, project, shift
from optid.armax.update import learn
from optid.core.model import Array

LARGEST_PREDICTION = 1e90  # in scales of the signal
LARGEST_NEWS = 1e150  # psi' P psi above which a sample teaches nothing but overflow


@inline_jit
def regress(s: Array, shape: Shape, share: float) -> float:
    """Fill phi and psi from what is remembered and the inputs in `now`; a missing input leaves NaN in phi."""
    na = shape.na
    nc = shape.nc
    n = shape.n
    m = shape.m
    theta = HEADER + 4 * m
    c = part(s, theta + n - nc)
    phi = theta + 2 * shape.size
    psi = theta + 3 * shape.size
    copy(part(s, phi), part(s, shape.outputs), na)
    copy(part(s, psi), part(s, shape.outputs_filtered), na)
    copy(part(s, phi + n - nc), part(s, shape.residuals), nc)
    copy(part(s, psi + n - nc), part(s, shape.residuals_filtered), nc)
    at = shape.past_inputs
    column = na
    for i in range(m):
        nb = shape.nb
        nk = shape.nk
        if nb < 0:
            nb = int(s[HEADER + 3 * i])
        if nk < 0:
            nk = int(s[HEADER + 3 * i + 1])
        length = nb + nk
        flength = length
        if nc > length:
            flength = nc
        uh = part(s, at)
        uf = part(s, at + length)
        x = s[HEADER + 3 * m + i] * s[HEADER + 3 * i + 2]
        shift(uh, length)
        uh[0] = x
        if not abs(x) < LARGEST_SIGNAL:
            uh[0] = math.nan
            x = newest(uh, 0, length)
            s[MISSING] += 1.0
        x = filtered(x, c, uf, nc, share)
        shift(uf, flength)
        uf[0] = x
        copy(part(s, phi + column), part(s, at + nk), nb)
        copy(part(s, psi + column), part(s, at + length + nk), nb)
        at += length + flength
        column += nb
    if not s[FILTERED] > 0.0:
        copy(part(s, psi), part(s, phi), n)
    return 0.0


@jit
def impute_inputs(s: Array, shape: Shape) -> float:
    """Put the last measured value in the place of each missing input in phi; returns 1 if there was one."""
    m = shape.m
    nc = shape.nc
    column = HEADER + 4 * m + 2 * shape.size + shape.na
    at = shape.past_inputs
    missing = 0.0
    for i in range(m):
        nb = shape.nb
        nk = shape.nk
        if nb < 0:
            nb = int(s[HEADER + 3 * i])
        if nk < 0:
            nk = int(s[HEADER + 3 * i + 1])
        for k in range(nb):
            if not abs(s[column + k]) < LARGEST_SIGNAL:
                s[column + k] = newest(part(s, at), nk + k, nb + nk)
                missing = 1.0
        at += nb + nk
        if nc > nb + nk:
            at += nc
        else:
            at += nb + nk
        column += nb
    return missing


@inline_jit
def remember(s: Array, shape: Shape, measured: float, residual: float, share: float) -> float:
    """The newest output and residual, and the same filtered by 1/C, come in front."""
    nc = shape.nc
    c = part(s, HEADER + 4 * shape.m + shape.n - nc)
    yh = shape.outputs
    yf = shape.outputs_filtered
    eh = shape.residuals
    ef = shape.residuals_filtered
    y = filtered(-measured, c, part(s, yf), nc, share)
    e = filtered(residual, c, part(s, ef), nc, share)
    enter(part(s, yh), yf - yh, -measured)
    enter(part(s, yf), eh - yf, y)
    enter(part(s, eh), ef - eh, residual)
    enter(part(s, ef), shape.past_inputs - ef, e)
    return 0.0


@jit
def reset_after_gap(s: Array, shape: Shape, measured: float, share: float) -> float:
    """After a gap the residuals start from zero, the filtered output as if it had been constant."""
    c = part(s, HEADER + 4 * shape.m + shape.n - shape.nc)
    gain = 1.0
    factor = 1.0
    for k in range(shape.nc):
        factor = factor * share
        gain += factor * c[k]
    yf = part(s, shape.outputs_filtered)
    for k in range(shape.residuals - shape.outputs_filtered):
        yf[k] = -measured / gain
    return 0.0


@inline_jit
def advance(s: Array, shape: Shape, y: float) -> float:
    """Take one sample whose inputs stand in `now`; returns the innovation, NaN for a missing output."""
    na = shape.na
    nc = shape.nc
    n = shape.n
    m = shape.m
    size = shape.size
    at = HEADER + 4 * m
    theta = part(s, at)
    c = part(s, at + n - nc)
    D = part(s, at + size)
    phi = part(s, at + 2 * size)
    psi = part(s, at + 3 * size)
    F = part(s, at + 4 * size)
    V = part(s, at + 5 * size)
    G = part(s, at + 6 * size)
    U = part(s, at + 7 * size)
    work = part(s, at + 7 * size + size * size)
    share = 1.0 - s[EASE]
    s[SAMPLES] += 1.0
    hold = s[HOLD]
    regress(s, shape, share)
    prediction = inner(phi, theta, size)
    if prediction != prediction:  # NaN: an input is missing
        if impute_inputs(s, shape) > 0.0 and hold < 1.0:
            hold = 1.0
        prediction = inner(phi, theta, size)
    if not abs(prediction) < LARGEST_PREDICTION:
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
        hold -= 1.0
        reset_after_gap(s, shape, measured, share)
    else:
        residual = e
        news = project(U, D, psi, F, V, size)
        if news < LARGEST_NEWS:
            residual = e - learn(s, shape, e, news) * inner(phi, G, size)
            if roots_inside(c, nc, s[RADIUS], work) == 0.0:
                stabilise(c, nc, s[RADIUS], work)
                s[PROJECTED] += 1.0
                residual = measured - inner(phi, theta, size)
        bound = s[OUTLIER]
        if bound > 0.0 and s[UPDATES] > 2.0 * n + 10.0:
            bound = bound * math.sqrt(s[SQUARES] / s[WEIGHT])
            if residual > bound:
                residual = bound
            if residual < -bound:
                residual = -bound
    s[HOLD] = hold
    if s[UPDATES] < s[PATIENCE] or not abs(residual) < LARGEST_SIGNAL:
        residual = 0.0
    remember(s, shape, measured, residual, share)
    if not seen:
        return math.nan
    innovation: float = e * s[SCALE]
    return innovation


@inline_jit
def shape_of(s: Array) -> Shape:
    """What the header says."""
    places = (int(s[RESIDUALS]), int(s[RESIDUALS_FILTERED]), int(s[PAST_INPUTS]))
    return Shape(
        int(s[NA]),
        int(s[NC]),
        int(s[PARAMETERS]),
        int(s[INPUTS]),
        int(s[STRIDE]),
        -1,
        -1,
        int(s[OUTPUTS]),
        int(s[OUTPUTS_FILTERED]),
        places[0],
        places[1],
        places[2],
    )


@inline_jit
def step_one(s: Array, shape: Shape, y: float, u: float) -> float:
    """One sample of a model with one input."""
    s[HEADER + 3] = u
    return advance(s, shape, y)


@inline_jit
def step_all(s: Array, shape: Shape, y: float, u: Array) -> float:
    """One sample of a model with any number of inputs."""
    m = shape.m
    for i in range(m):
        s[HEADER + 3 * m + i] = u[i]
    return advance(s, shape, y)


@inline_jit
def run_all(s: Array, shape: Shape, y: Array, u: Array, innovations: Array, track: Array, every: int) -> None:
    """A whole recording: y (N,), u (N, m); fills innovations (N,) and every so often a row of `track`."""
    m = shape.m
    for t in range(y.size):
        for i in range(m):
            s[HEADER + 3 * m + i] = u[t, i]
        innovations[t] = advance(s, shape, y[t])
        if every > 0 and t % every == every - 1:
            for k in range(shape.n):
                track[t // every, k] = s[HEADER + 4 * m + k]


# For any orders: what differs between them is read from the header at every sample. The long part is compiled once.


@jit
def advance_any(s: Array, y: float) -> float:
    """See `advance`."""
    return advance(s, shape_of(s), y)


@jit
def step_single(s: Array, y: float, u: float) -> float:
    """See `step_one`."""
    s[HEADER + 3] = u
    return advance_any(s, y)


@jit
def step_many(s: Array, y: float, u: Array) -> float:
    """See `step_all`."""
    m = int(s[INPUTS])
    for i in range(m):
        s[HEADER + 3 * m + i] = u[i]
    return advance_any(s, y)


@jit
def run(s: Array, y: Array, u: Array, innovations: Array, track: Array, every: int) -> None:
    """See `run_all`."""
    m, n = int(s[INPUTS]), int(s[PARAMETERS])
    for t in range(y.size):
        for i in range(m):
            s[HEADER + 3 * m + i] = u[t, i]
        innovations[t] = advance_any(s, y[t])
        if every > 0 and t % every == every - 1:
            for k in range(n):
                track[t // every, k] = s[HEADER + 4 * m + k]


@functools.cache
def kernels(shape: Shape) -> tuple[Callable[..., float], Callable[..., None]]:
    """`step` and `run` for these orders alone: seconds to compile once, then about half the time a sample."""

    @jit
    def step_one_of(s: Array, y: float, u: float) -> float:
        return step_one(s, shape, y, u)

    @jit
    def step_all_of(s: Array, y: float, u: Array) -> float:
        return step_all(s, shape, y, u)

    @jit
    def run_of(s: Array, y: Array, u: Array, innovations: Array, track: Array, every: int) -> None:
        run_all(s, shape, y, u, innovations, track, every)

    return step_one_of if shape.m == 1 else step_all_of, run_of
