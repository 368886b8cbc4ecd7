"""Gauss-Newton terms of windows, compiled once for every model: several windows at once in vector instructions."""

from __future__ import annotations

import numpy as np

from optid.core.kernel import advance, at, call, compiled, put
from optid.core.llvm_simd import LANES

EQUAL = 1e-9  # relative difference up to which two sampling intervals are equal: rounding of time stamps


@compiled
def normal_equations(
    code,
    first,
    last,
    starts,
    counts,
    closed,
    X0,
    p,
    dt,
    U,
    Y,
    weight,
    huber,
    tolerance,
    end,
    slope,
    H,
    g,
    cost,
):
    """Gauss-Newton terms of windows first..last-1, all at the parameters p.

    Window w: the residuals (Y - y) * weight at its samples 0..counts-1 (also at its last one if closed[w]).
    Receives end[w] (NX,), cost[w] = (sum of the loss, samples), slope[w] = d end / d(start, free) (NX, width),
    H[w] = sum J'J (directions, width) and g[w] = sum J'r (width,) with J = d y / d(start, free) * weight, all
    padded. NaN in Y is missing. Residuals beyond `huber` count linearly (Huber's loss; infinity for none). A failed
    window has cost NaN.
    """
    nx, ny = X0.shape[1], Y.shape[1]
    c, k, y = np.empty(code.hoisted), np.empty(nx + 1), np.empty(ny + 1)
    T, R = np.empty((nx, slope.shape[2])), np.empty((ny, slope.shape[2]))
    call(code.constants, (at(p, 0), at(c, 0)))
    for begin in range(first, last, LANES):
        stop, done = min(begin + LANES, last), 0
        if stop - begin > 1:
            done = _together(
                code,
                begin,
                stop,
                starts,
                counts,
                c,
                X0,
                dt,
                U,
                Y,
                weight,
                huber,
                tolerance,
                end,
                slope,
                H,
                g,
                cost,
            )
        for w in range(begin, stop):
            if done == 0:
                put(X0[w], end[w])
                slope[w] = 0.0
                H[w] = 0.0
                g[w] = 0.0
                cost[w] = 0.0
                for i in range(nx):
                    slope[w, i, i] = 1.0
            loss, used = _window(
                code,
                starts[w] + done,
                counts[w] - done,
                closed[w],
                c,
                k,
                y,
                T,
                R,
                dt,
                U,
                Y,
                weight,
                huber,
                tolerance,
                end[w],
                slope[w],
                H[w],
                g[w],
            )
            cost[w, 0] += loss
            cost[w, 1] += used


@compiled
def _together(
    code, begin, stop, starts, counts, c, X0, dt, U, Y, weight, huber, tolerance, end, slope, H, g, cost
):
    """Windows begin..stop-1, LANES at most, over the holds they have in common; returns how many holds were done.

    They share the steps of the integrator. None is done where samplings differ or a window fails: that, and what
    is left of longer windows, is for `_window`. Where there are fewer windows than lanes, the last one is repeated.
    """
    nx, ny, nd = X0.shape[1], Y.shape[1], H.shape[1]
    holds = counts[begin]
    for w in range(begin + 1, stop):
        holds = min(holds, counts[w])
    for w in range(begin + 1, stop):
        for n in range(holds):
            if abs(dt[starts[w] + n] - dt[starts[begin] + n]) > EQUAL * dt[starts[begin] + n]:
                return 0
    x, u, k, y = (
        np.empty((nx, LANES)),
        np.empty((U.shape[1], LANES)),
        np.empty((nx + 1) * LANES),
        np.empty((ny + 1, LANES)),
    )
    S, T, R = np.zeros((nx, nd, LANES)), np.empty((nx, nd, LANES)), np.empty((ny, nd, LANES))
    J, r = np.zeros((nd, nd, LANES)), np.zeros((nd, LANES))
    many, a, b = np.empty((len(c), LANES)), np.zeros(LANES), np.zeros(LANES)
    loss, used = np.zeros(LANES), np.zeros(LANES)
    for lane in range(LANES):
        for i in range(len(c)):
            many[i, lane] = c[i]
        for i in range(nx):
            S[i, i, lane] = 1.0
            x[i, lane] = X0[min(begin + lane, stop - 1), i]
    h = dt[starts[begin]]
    for n in range(holds):
        for lane in range(LANES):
            for i in range(U.shape[1]):
                u[i, lane] = U[starts[min(begin + lane, stop - 1)] + n, i]
        call(code.many_sensor_slopes, (at(x, 0), at(S, 0), at(u, 0), at(many, 0), at(y, 0), at(R, 0)))
        for o in range(ny):
            if _weighed(begin, stop, n, o, starts, Y, y, weight, huber, a, b, loss, used):
                call(code.many_gather, (at(R, o * nd * LANES), at(J, 0), at(r, 0), at(a, 0), at(b, 0)))
        h = advance(
            code.many_slopes,
            code.many_step_slopes,
            code.many_half,
            at(x, 0),
            at(S, 0),
            at(u, 0),
            at(many, 0),
            k,
            at(T, 0),
            at(tolerance, 0),
            dt[starts[begin] + n],
            h,
        )
        if h < 0.0:
            return 0
    for w in range(begin, stop):
        lane = w - begin
        for i in range(nx):
            end[w, i] = x[i, lane]
            _spread(S[i], lane, slope[w, i])
        for i in range(nd):
            _spread(J[i], lane, H[w, i])
        _spread(r, lane, g[w])
        cost[w, 0], cost[w, 1] = loss[lane], used[lane]
    return holds


@compiled
def _spread(rows, lane, row):
    """One lane of rows as a padded row."""
    for i in range(len(row)):
        row[i] = rows[i, lane] if i < len(rows) else 0.0


@compiled
def _weighed(begin, stop, n, o, starts, Y, y, weight, huber, a, b, loss, used):
    """Contribution of output o at the n-th sample: a and b for `many_gather`, the loss; whether any is measured."""
    some = False
    for lane in range(stop - begin):
        m = starts[begin + lane] + n
        a[lane], b[lane] = 0.0, 0.0
        residual = (Y[m, o] - y[o, lane]) * weight[m, o]
        if residual == residual:
            some, factor = True, 1.0
            if abs(residual) > huber:
                factor = huber / abs(residual)
                loss[lane] += huber * (2.0 * abs(residual) - huber)
            else:
                loss[lane] += residual * residual
            used[lane] += 1.0
            scaled = factor * weight[m, o]
            a[lane], b[lane] = scaled * weight[m, o], scaled * residual
    return some


@compiled
def _window(code, begin, count, closed, c, k, y, T, R, dt, U, Y, weight, huber, tolerance, x, S, H, g):
    loss, used, h = 0.0, 0.0, dt[begin]
    for n in range(count + 1):
        m = begin + n
        u = at(U, m * U.shape[1])
        if n < count or closed:
            call(code.sensor_slopes, (at(x, 0), at(S, 0), u, at(c, 0), at(y, 0), at(R, 0)))
            for o in range(Y.shape[1]):
                r = (Y[m, o] - y[o]) * weight[m, o]
                if r != r:  # a missing sample
                    continue
                factor = 1.0
                if abs(r) > huber:
                    factor = huber / abs(r)
                    loss += huber * (2.0 * abs(r) - huber)
                else:
                    loss += r * r
                used += 1.0
                scaled = factor * weight[m, o]
                row = at(R, o * R.shape[1])
                call(code.gather, (row, at(H, 0), at(g, 0), scaled * weight[m, o], scaled * r))
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
                return np.nan, used
    return loss, used
