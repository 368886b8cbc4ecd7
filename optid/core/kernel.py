"""Compiled loops over samples and windows, the same for every model.

numba compiles this file once per version. What differs between models, the equations and the step of the
integrator, is machine code made by `optid.core.jit` from `optid.core.llvm_codegen` and called here by its address.

Integrator: an embedded Runge-Kutta pair, restarted at every sample because the held command jumps there, with
step control on the states. Sensitivities are the exact derivative of the same steps. Several states at once, as the
filter moves them, take linearly implicit steps (`optid.core.rosenbrock`).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from optid.core.jit_cache import kept

# IEEE division instead of Python's check for zero, fused multiply-add allowed; NaN and infinity stay what they are.
compiled = kept(nogil=True, error_model="numpy", fastmath={"contract", "nsz", "arcp"})

STABLE = 2.5  # largest step times relaxation rate; the method's own limit on the real axis is 3.3
SMALLEST = 1e-12  # of a hold: below this step the equations are singular, not stiff
# Steps tried in a hold: equations that need more have diverged, which could otherwise take hours to appear.
MOST = 1000  # linearly implicit ones
MOST_EXPLICIT = 10_000  # ten times what the stiffest friction needs in a hold of 0.1 s


class Code(NamedTuple):
    """Addresses of a model's functions, see `optid.core.llvm_codegen.source`, 0 for none, and the length of its c."""

    constants: int
    half: int
    many_half: int
    rates: int
    slopes: int
    step: int
    step_slopes: int
    sensors: int
    sensor_slopes: int
    gather: int
    many_step: int
    many_slopes: int
    many_step_slopes: int
    many_sensor_slopes: int
    many_gather: int
    hoisted: int


@intrinsic
def call(_context: Any, address: Any, arguments: Any) -> Any:
    """Call the function at an address with a tuple of places (integers) and numbers; it returns a number."""

    def generate(_: Any, builder: Any, __: Any, values: Any) -> Any:
        real = ir.DoubleType()
        place = real.as_pointer()
        given = [
            builder.inttoptr(v, place) if isinstance(t, types.Integer) else v
            for t, v in zip(arguments, cgutils.unpack_tuple(builder, values[1]), strict=True)
        ]
        kind = ir.FunctionType(real, [v.type for v in given])
        return builder.call(builder.inttoptr(values[0], kind.as_pointer()), given)

    return types.float64(address, arguments), generate


@compiled
def at(array, i):
    """Place of the i-th number of a contiguous array."""
    return array.ctypes.data + 8 * i


@compiled
def next_step(h, error, order):
    """Step size after a step with this scaled error of this order: the power law within a factor 0.2 to 5."""
    if error < 1e-5:
        return 5.0 * h
    return h * min(5.0, max(0.2, 0.9 * math.exp(-math.log(error) / order)))


@compiled
def advance(begin, step, half, x, S, u, c, k, T, tolerance, span, h):
    """Integrate over one hold of length `span` in place; returns the next step size, negative on failure.

    `begin` and `step` are the functions with or without slopes; with a function `half` inputs switch inside the hold.
    """
    if half == 0:
        return _advance(begin, step, x, S, u, c, k, T, tolerance, span, h)
    h = _advance(begin, step, x, S, u, c, k, T, tolerance, 0.5 * span, h)
    if h >= 0.0:
        call(half, (c, 1.0))
        h = _advance(begin, step, x, S, u, c, k, T, tolerance, 0.5 * span, h)
        call(half, (c, 0.0))
    return h


@compiled
def _advance(begin, step, x, S, u, c, k, T, tolerance, span, h):
    """As `advance`, where nothing switches.

    Steps stay within the method's stability where the slopes say how fast states relax (behind the rates in k): a
    state saturated to the last bit (friction in full slip) shows no error at any step, while the unstable method would
    multiply its sensitivity.
    """
    left, tried = span, 0
    call(begin, (x, S, u, c, at(k, 0), T))
    while left > 0.0:
        tried += 1
        if tried > MOST_EXPLICIT:
            return -1.0
        length = min(h, left)
        if k[-1] * length > STABLE:
            length = STABLE / k[-1]
        error = call(step, (x, S, u, c, at(k, 0), T, tolerance, length))
        if error <= 1.0:
            left -= length
            h = max(h, next_step(length, error, 5)) if length < h else next_step(length, error, 5)
            if left < SMALLEST * span:
                left = 0.0
        else:
            h = next_step(length, error, 5) if error < 1e300 else 0.1 * length
            if not h > SMALLEST * span:
                return -1.0
    return h


@compiled
def advance_many(step, half, x, u, c, tolerance, span, h):
    """As `advance` for `LANES` states at once, with steps that are stable at any length."""
    if half == 0:
        return _advance_many(step, x, u, c, tolerance, span, h)
    h = _advance_many(step, x, u, c, tolerance, 0.5 * span, h)
    if h >= 0.0:
        call(half, (c, 1.0))
        h = _advance_many(step, x, u, c, tolerance, 0.5 * span, h)
        call(half, (c, 0.0))
    return h


@compiled
def _advance_many(step, x, u, c, tolerance, span, h):
    """As `advance_many`, where nothing switches.

    The next hold starts with the step that suited the start of this one: states just corrected by a measurement relax
    again in every hold, and a step that suited its end would be rejected.
    """
    left, begin = span, -1.0
    for _ in range(MOST):
        length = min(h, left)
        if length < left < 2.0 * length:
            length = 0.5 * left  # two equal steps instead of a long and a short one
        error = call(step, (x, u, c, tolerance, length))
        if error <= 1.0:
            left -= length
            h = max(h, next_step(length, error, 3)) if length < h else next_step(length, error, 3)
            if begin < 0.0:
                begin = h
            if left < SMALLEST * span:
                return begin
        else:
            h = next_step(length, error, 3) if error < 1e300 else 0.1 * length
    return -1.0


@compiled
def put(values, place):
    """Copy numbers one by one: for an array assignment numba also compiles its error message, which takes 4 s."""
    for i in range(len(place)):
        place[i] = values[i]


@compiled
def simulate(code, first, last, starts, counts, X0, P, dt, U, tolerance, X, Y):
    """Free runs first..last-1: run w starts in state X0[w] at sample starts[w] and spans counts[w] intervals.

    X[w, n] and Y[w, n] receive states and outputs at its samples 0..counts[w]; NaN after a failure.
    """
    c, k, y = np.empty(code.hoisted), np.empty(X0.shape[1] + 1), np.empty(Y.shape[2] + 1)
    x = np.empty(X0.shape[1])
    for w in range(first, last):
        call(code.constants, (at(P, w * P.shape[1]), at(c, 0)))
        put(X0[w], x)
        _run(code, starts[w], counts[w], x, c, k, y, dt, U, tolerance, X[w], Y[w])


@compiled
def _run(code, begin, count, x, c, k, y, dt, U, tolerance, X, Y):
    here, none = at(x, 0), at(k, 0)  # what stands for slopes is never touched
    h = dt[begin]
    for n in range(count + 1):
        u = at(U, (begin + n) * U.shape[1])
        for i in range(len(x)):
            X[n, i] = x[i]
        call(code.sensors, (here, none, u, at(c, 0), at(y, 0), none))
        for o in range(Y.shape[1]):
            Y[n, o] = y[o]
        if n < count:
            span = dt[begin + n]
            h = advance(
                code.rates, code.step, code.half, here, none, u, at(c, 0), k, none, at(tolerance, 0), span, h
            )
            if h < 0.0:
                X[n + 1 :] = np.nan
                Y[n + 1 :] = np.nan
                break


@compiled
def carry(code, first, last, begins, counts, closed, known, X0, P, dt, U, tolerance, X, Y, ends):
    """Runs first..last-1, each through all windows in sequence: a node sets the known states, others are carried over.

    `known` (windows, NX) is NaN where a state is carried over from the window before; a segment's other states start at
    X0[r]. X[r, w] receives the states at the nodes, ends[r, w] those at the windows' ends, Y[r] (samples, NY) the
    outputs. After a failed window the others are taken from the node before it.
    """
    c, k, y = np.empty(code.hoisted), np.empty(X0.shape[1] + 1), np.empty(Y.shape[2] + 1)
    x = np.empty(X0.shape[1])
    for r in range(first, last):
        call(code.constants, (at(P, r * P.shape[1]), at(c, 0)))
        for w in range(len(begins)):
            if w == 0 or closed[w - 1]:
                put(X0[r], x)
            for i in range(len(x)):
                if known[w, i] == known[w, i]:
                    x[i] = known[w, i]
            put(x, X[r, w])
            if _carry(code, begins[w], counts[w], closed[w], x, c, k, y, dt, U, tolerance, Y[r]):
                put(x, ends[r, w])
            else:
                ends[r, w] = np.nan
                put(X[r, w], x)


@compiled
def _carry(code, begin, count, closed, x, c, k, y, dt, U, tolerance, Y):
    here, none = at(x, 0), at(k, 0)
    h = dt[begin]
    for n in range(begin, begin + count + 1):
        u = at(U, n * U.shape[1])
        if n < begin + count or closed:
            call(code.sensors, (here, none, u, at(c, 0), at(y, 0), none))
            for o in range(Y.shape[1]):
                Y[n, o] = y[o]
        if n < begin + count:
            h = advance(
                code.rates, code.step, code.half, here, none, u, at(c, 0), k, none, at(tolerance, 0), dt[n], h
            )
            if h < 0.0:
                Y[n + 1 : begin + count + int(closed)] = np.nan
                return False
    return True


@compiled
def trace(code, first, last, starts, counts, closed, X0, p, dt, U, tolerance, X, Y, G):
    """Outputs with their sensitivities at every sample: X (N, NX), Y (N, NY), G[n] = d y / d(start, free), padded.

    Sample n belongs to the window that starts at or last before it; rows are those of the recording.
    """
    nx, ny = X0.shape[1], Y.shape[1]
    x, c, k, y = np.empty(nx), np.empty(code.hoisted), np.empty(nx + 1), np.empty(ny + 1)
    S, T = np.empty((nx, G.shape[2])), np.empty((nx, G.shape[2]))
    call(code.constants, (at(p, 0), at(c, 0)))
    for w in range(first, last):
        put(X0[w], x)
        S[:] = 0.0
        for i in range(nx):
            S[i, i] = 1.0
        _trace(code, starts[w], counts[w], closed[w], x, S, c, k, y, T, dt, U, tolerance, X, Y, G)


@compiled
def _trace(code, begin, count, closed, x, S, c, k, y, T, dt, U, tolerance, X, Y, G):
    h = dt[begin]
    for n in range(count + 1):
        m = begin + n
        u = at(U, m * U.shape[1])
        if n < count or closed:
            call(code.sensor_slopes, (at(x, 0), at(S, 0), u, at(c, 0), at(y, 0), at(G, m * G[0].size)))
            for i in range(len(x)):
                X[m, i] = x[i]
            for o in range(Y.shape[1]):
                Y[m, o] = y[o]
        if n < count:
            h = advance(
                code.slopes,
                code.step_slopes,
                code.half,
                at(x, 0),
                at(S, 0),
                u,
                at(c, 0),
                k,
                at(T, 0),
                at(tolerance, 0),
                dt[m],
                h,
            )
            if h < 0.0:
                break
