"""A sigma-point Kalman filter over held commands, compiled once for every model.

The filter is the divided difference filter of second order (Norgaard, Poulsen and Ravn, Automatica 36, 2000): its
points reach sqrt(3) sd to each side for any number of states, so that it averages over the kinks of dry friction,
which a linearisation does not. Points move `LANES` at a time, outputs are taken one at a time; those that are linear
in the states, as most sensors are, need no points. States and covariances are in units of the states' usual sizes.
"""

from __future__ import annotations

import math

import numpy as np

from optid.core.kernel import advance_many, at, call, compiled, put
from optid.core.llvm_simd import LANES

REACH2 = 3.0  # h^2 of the divided differences: the kurtosis of a normal distribution
PIVOT = 1e-14  # of a covariance, as a share of its largest variance: below it a direction counts as known


@compiled
def filtered(
    code,
    first,
    last,
    of_set,
    of_segment,
    starts,
    counts,
    M0,
    C0,
    P,
    Q,
    R,
    dt,
    U,
    Y,
    linear,
    tolerance,
    scales,
    keep,
    E,
    V,
    X,
    K,
    S,
):
    """Filter runs first..last-1; run r takes parameter set of_set[r] over segment of_segment[r].

    Args:
        code: of the model.
        starts, counts: first sample and intervals of each segment.
        M0, C0: mean (sets, segments, states) and covariance (..., states, states) of the state at a segment's start.
        P: parameters, (sets, parameters).
        Q: process noise, variance a second in squared scales, (sets, states).
        R: variance of the measurement noise, (sets, outputs).
        dt, U, Y: time to the next sample, inputs, measured outputs (NaN is missing), (samples, ...).
        linear: outputs whose slopes by the states depend on parameters alone, (outputs,).
        tolerance: local error of the integration, (sets, states).
        keep: also fill X and K.
        E, V: receive innovations and their variances, (sets, samples, outputs); NaN where nothing is measured.
        X: receives the one-step predicted states, (sets, samples, states).
        K: receives the gains, (sets, samples, outputs, states), SI.
        S: receives the covariances of X, (sets, samples, states, states), SI; without sets it receives none.

    After a divergence E is infinite for the rest of the run.
    """
    nx, ny = len(scales), Y.shape[1]
    n_points = 2 * nx + 1
    groups, nu = -(-n_points // LANES), U.shape[1]
    c, x = np.empty(code.hoisted), np.empty(nx)
    cs, us = np.empty((code.hoisted, LANES)), np.empty((nu + 1, LANES))
    points, C, L = np.empty((groups, nx, LANES)), np.empty((nx, nx)), np.empty((nx, nx))
    m, shared, y, steps = np.empty(nx), np.empty(nx), np.empty((n_points, ny + 1)), np.empty(groups)
    H, W = np.empty((ny, nx)), np.empty((nx, 2 * nx))
    for r in range(first, last):
        s, g = of_set[r], of_segment[r]
        call(code.constants, (at(P, s * P.shape[1]), at(c, 0)))
        for i in range(len(c)):
            cs[i] = c[i]
        for i in range(nx):
            m[i] = M0[s, g, i] / scales[i]
            for o in range(nx):
                C[i, o] = C0[s, g, i, o] / (scales[i] * scales[o])
        _slopes(code, m, at(U, starts[g] * nu), c, x, y, scales, H)
        steps[:] = dt[starts[g]]
        for n in range(starts[g], starts[g] + counts[g] + 1):
            if keep:
                for i in range(nx):
                    X[s, n, i] = m[i] * scales[i]
            if len(S):
                for i in range(nx):
                    for o in range(nx):
                        S[s, n, i, o] = C[i, o] * scales[i] * scales[o]
            for o in range(ny):
                E[s, n, o] = np.nan
                V[s, n, o] = np.nan
                if keep:
                    K[s, n, o] = 0.0
                if Y[n, o] == Y[n, o]:
                    if linear[o]:
                        _see(code, m, at(U, n * nu), c, x, y[0], scales)
                        mean, V[s, n, o] = y[0, o], R[s, o] + _share(C, H[o], shared)
                    else:
                        _scatter(m, C, L, points, scales)
                        _look(code, points, at(U, n * nu), c, x, y)
                        mean, variance = _moments(L, y[:, o], shared)
                        V[s, n, o] = R[s, o] + variance
                    E[s, n, o] = Y[n, o] - mean
                    _correct(m, C, shared, E[s, n, o], V[s, n, o])
                    if keep:
                        for i in range(nx):
                            K[s, n, o, i] = shared[i] / V[s, n, o] * scales[i]
            if n == starts[g] + counts[g]:
                break
            _scatter(m, C, L, points, scales)
            for i in range(nu):
                us[i] = U[n, i]
            if not _move(code, points, steps, us, cs, tolerance[s], dt[n]):
                E[s, n + 1 : starts[g] + counts[g] + 1] = np.inf
                V[s, n + 1 : starts[g] + counts[g] + 1] = 1.0
                break
            _gather(points, m, C, W, scales)
            for i in range(nx):
                C[i, i] += Q[s, i] * dt[n]


@compiled
def _scatter(m, C, L, points, scales):
    """Lower triangular root L of C, and the points: the mean, and sqrt(3) columns of L to either side of it; SI."""
    nx = len(m)
    largest = 0.0
    for i in range(nx):
        largest = max(largest, C[i, i])
    for j in range(nx):
        for i in range(j):
            L[i, j] = 0.0
        pivot = C[j, j]
        for q in range(j):
            pivot -= L[j, q] * L[j, q]
        if pivot <= PIVOT * largest:
            for i in range(j, nx):
                L[i, j] = 0.0
            continue
        L[j, j] = math.sqrt(pivot)
        for i in range(j + 1, nx):
            total = C[i, j]
            for q in range(j):
                total -= L[i, q] * L[j, q]
            L[i, j] = total / L[j, j]
    reach = math.sqrt(REACH2)
    for i in range(nx):
        for g in range(points.shape[0]):
            for lane in range(LANES):
                points[g, i, lane] = m[i] * scales[i]
        for j in range(i + 1):
            a, b, far = 1 + 2 * j, 2 + 2 * j, reach * L[i, j]
            points[a // LANES, i, a % LANES] = (m[i] + far) * scales[i]
            points[b // LANES, i, b % LANES] = (m[i] - far) * scales[i]


@compiled
def _see(code, m, u, c, x, y, scales):
    """Outputs y at the mean."""
    none = at(x, 0)  # the placeholder for slopes is never used
    for i in range(len(m)):
        x[i] = m[i] * scales[i]
    call(code.sensors, (at(x, 0), none, u, at(c, 0), at(y, 0), none))


@compiled
def _slopes(code, m, u, c, x, y, scales, H):
    """Slopes of the outputs by the scaled states, (outputs, states), exact where those are linear."""
    _see(code, m, u, c, x, y[0], scales)
    for i in range(len(m)):
        m[i] += 1.0
        _see(code, m, u, c, x, y[1], scales)
        m[i] -= 1.0
        for o in range(len(H)):
            H[o, i] = y[1, o] - y[0, o]


@compiled
def _look(code, points, u, c, x, y):
    none = at(x, 0)  # the placeholder for slopes is never used
    for q in range(y.shape[0]):
        for i in range(len(x)):
            x[i] = points[q // LANES, i, q % LANES]
        call(code.sensors, (at(x, 0), none, u, at(c, 0), at(y, q * y.shape[1]), none))


@compiled
def _move(code, points, steps, us, cs, tolerance, span):
    size = points.shape[1] * LANES
    for g in range(points.shape[0]):
        steps[g] = advance_many(
            code.many_step,
            code.many_half,
            at(points, g * size),
            at(us, 0),
            at(cs, 0),
            at(tolerance, 0),
            span,
            steps[g],
        )
        if steps[g] < 0.0:
            return False
    return True


@compiled
def _gather(points, m, C, W, scales):
    """Mean and covariance of the propagated points; W (states, 2 states) holds its differences meanwhile."""
    nx = len(m)
    first, second = math.sqrt(1.0 / (4.0 * REACH2)), math.sqrt((REACH2 - 1.0) / (4.0 * REACH2 * REACH2))
    for i in range(nx):
        middle, total = points[0, i, 0], 0.0
        for j in range(nx):
            a, b = 1 + 2 * j, 2 + 2 * j
            one, other = points[a // LANES, i, a % LANES], points[b // LANES, i, b % LANES]
            total += one + other
            W[i, j] = first * (one - other) / scales[i]
            W[i, nx + j] = second * (one + other - 2.0 * middle) / scales[i]
        m[i] = ((REACH2 - nx) * middle + 0.5 * total) / REACH2 / scales[i]
    for i in range(nx):
        for o in range(i + 1):
            odd, even = 0.0, 0.0
            for j in range(nx):
                odd += W[i, j] * W[o, j]
                even += W[i, nx + j] * W[o, nx + j]
            C[i, o] = odd + even
            C[o, i] = C[i, o]


@compiled
def _share(C, h, shared):
    """The covariance of states and a linear output of slopes h; returns that output's variance."""
    variance = 0.0
    for i in range(len(h)):
        shared[i] = 0.0
        for j in range(len(h)):
            shared[i] += C[i, j] * h[j]
        variance += h[i] * shared[i]
    return variance


@compiled
def _moments(L, y, shared):
    """Mean and variance of an output known at the points of L; `shared` receives its covariance with the states."""
    nx = len(L)
    mean, variance = (REACH2 - nx) * y[0], 0.0
    for j in range(nx):
        a, b = y[1 + 2 * j], y[2 + 2 * j]
        mean += 0.5 * (a + b)
        variance += (a - b) ** 2 / (4.0 * REACH2)
        variance += (REACH2 - 1.0) * (a + b - 2.0 * y[0]) ** 2 / (4.0 * REACH2 * REACH2)
    for i in range(nx):
        shared[i] = 0.0
        for j in range(i + 1):
            shared[i] += L[i, j] * (y[1 + 2 * j] - y[2 + 2 * j])
        shared[i] /= 2.0 * math.sqrt(REACH2)
    return mean / REACH2, variance


@compiled
def _correct(m, C, shared, innovation, variance):
    """Correct mean and covariance by one output."""
    for i in range(len(m)):
        gain = shared[i] / variance
        m[i] += gain * innovation
        for q in range(i + 1):
            C[i, q] -= gain * shared[q]
            C[q, i] = C[i, q]


@compiled
def fixed_gain(
    code, first, last, of_set, of_segment, starts, counts, M0, P, K, common, dt, U, Y, tolerance, resets, E
):
    """Innovations with the gains of another filter run: x moves by the model and by K (y - h(x)).

    Between corrections E is the error of the prediction from the last one.

    Run r takes `LANES` parameter sets from of_set[r] on over segment of_segment[r]. If they cannot advance together,
    one of them has diverged: then each runs alone.

    Args:
        M0: states at the start of segments, (sets, segments, states).
        K: gains of the plain model's filter, (samples, outputs, plain states).
        common: index of each plain state among the model's own.
        tolerance: local error of the integration, (states,).
        resets: samples at which a new prediction begins, (samples,).
        E: receives innovations, (sets, samples, outputs); infinite after a failure.
    Others as for `filtered`.
    """
    nx, sets = M0.shape[2], np.empty(LANES, dtype=np.int64)
    c, cs = np.empty((LANES, code.hoisted)), np.empty((code.hoisted, LANES))
    us = np.empty((U.shape[1] + 1, LANES))
    xs, x, y = np.empty((nx, LANES)), np.empty(nx), np.empty(Y.shape[1] + 1)
    room = (c, cs, us, xs, np.empty((nx, LANES)), x, y)
    for r in range(first, last):
        begin, count, start = starts[of_segment[r]], counts[of_segment[r]], M0[:, of_segment[r]]
        for lane in range(LANES):
            sets[lane] = min(of_set[r] + lane, len(P) - 1)
        if not _fixed_gain(
            code, sets, begin, count, start, P, K, common, dt, U, Y, tolerance, resets, E, room
        ):
            for s in range(of_set[r], min(of_set[r] + LANES, len(P))):
                sets[:] = s
                _fixed_gain(
                    code, sets, begin, count, start, P, K, common, dt, U, Y, tolerance, resets, E, room
                )


@compiled
def _fixed_gain(code, sets, begin, count, start, P, K, common, dt, U, Y, tolerance, resets, E, room):
    c, cs, us, xs, ahead, x, y = room
    nx, none = len(x), at(x, 0)
    for lane in range(LANES):
        call(code.constants, (at(P, sets[lane] * P.shape[1]), at(c, lane * c.shape[1])))
        for i in range(c.shape[1]):
            cs[i, lane] = c[lane, i]
        for i in range(nx):
            xs[i, lane] = start[sets[lane], i]
    h = alone = dt[begin]
    for n in range(begin, begin + count + 1):
        u = at(U, n * U.shape[1])
        if resets[n]:
            for i in range(nx):
                put(xs[i], ahead[i])
        for o in range(Y.shape[1]):
            seen = Y[n, o] == Y[n, o]
            for lane in range(LANES):
                s = sets[lane]
                E[s, n, o] = np.nan
                if seen:
                    for i in range(nx):
                        x[i] = xs[i, lane]
                    call(code.sensors, (at(x, 0), none, u, at(c, lane * c.shape[1]), at(y, 0), none))
                    E[s, n, o] = Y[n, o] - y[o]
                    for i in range(len(common)):
                        xs[common[i], lane] += K[n, o, i] * E[s, n, o]
                    if not resets[n]:
                        for i in range(nx):
                            x[i] = ahead[i, lane]
                        call(code.sensors, (at(x, 0), none, u, at(c, lane * c.shape[1]), at(y, 0), none))
                        E[s, n, o] = Y[n, o] - y[o]
        if n == begin + count:
            break
        for i in range(U.shape[1]):
            us[i] = U[n, i]
        h = advance_many(
            code.many_step, code.many_half, at(xs, 0), at(us, 0), at(cs, 0), at(tolerance, 0), dt[n], h
        )
        if not resets[n + 1]:
            alone = advance_many(
                code.many_step,
                code.many_half,
                at(ahead, 0),
                at(us, 0),
                at(cs, 0),
                at(tolerance, 0),
                dt[n],
                alone,
            )
        if h < 0.0 or alone < 0.0:
            for lane in range(LANES):
                E[sets[lane], n + 1 : begin + count + 1] = np.inf
            return False
    return True
