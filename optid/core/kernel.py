"""Compiled loops over samples and windows; a copy of this file stands beside each model's emitted equations.

`optid.core.compiled` copies it next to the `equations` written by `optid.core.emit`, so the sizes NX (states),
NU (inputs), NY (outputs), NC (hoisted constants), NF (free parameters) and ND = NX + NF (directions of
differentiation) are compile-time constants and the equations are inlined.

Integrator: the 5(4) pair of Dormand and Prince (1980), restarted at every sample because the held command jumps
there, with step control on the states. Sensitivities are the exact derivative of the same steps.
"""

import math

import numpy as np
from equations import (
    NC,
    ND,
    NU,
    NX,
    NY,
    compiled,
    constants,
    fastest,
    push,
    push_sensors,
    rates,
    sensor_slopes,
    sensors,
    slopes,
)

# Dormand and Prince (1980), table 2: stages, and fifth minus fourth order weights.
STAGES = 7
A = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [1 / 5, 0.0, 0.0, 0.0, 0.0, 0.0],
        [3 / 40, 9 / 40, 0.0, 0.0, 0.0, 0.0],
        [44 / 45, -56 / 15, 32 / 9, 0.0, 0.0, 0.0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0.0, 0.0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0.0],
        [35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
    ]
)
E = np.array([71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])
STABLE = 2.5  # largest step times relaxation rate; the method's own limit on the real axis is 3.3
SMALLEST = 1e-12  # of a hold: below this step the equations are singular, not stiff
NNZ = NX * ND + NY * ND  # room for the non-zeros of any Jacobian


@compiled
def next_step(h, error):
    """Step size after a step with this scaled error: the usual power law within a factor 0.2 to 5."""
    if error < 1e-5:
        return 5.0 * h
    return h * min(5.0, max(0.2, 0.9 * math.exp(-0.2 * math.log(error))))


@compiled
def bounded(step, x, u, p, c):
    """The step, kept within the method's stability.

    A state saturated to the last bit (friction in full slip) shows no error at any step, while its sensitivity
    would be multiplied by the unstable method at every one.
    """
    rate = fastest(x, u, p, c)
    return STABLE / rate if rate * step > STABLE else step


@compiled
def advance(x, u, p, c, span, h, tolerance, k, stage):
    """Integrate x over one hold of length `span` in place; returns the next step size, negative on failure."""
    left = span
    fresh = True
    while left > 0.0:
        step = bounded(min(h, left), x, u, p, c)
        if fresh:
            rates(x, u, p, c, k[0])
        for s in range(1, STAGES):
            for i in range(NX):
                total = 0.0
                for j in range(s):
                    total += A[s, j] * k[j, i]
                stage[i] = x[i] + step * total
            rates(stage, u, p, c, k[s])
        error = 0.0
        for i in range(NX):
            total = 0.0
            for s in range(STAGES):
                total += E[s] * k[s, i]
            total = abs(step * total) / tolerance[i]
            error = total if not total <= error else error  # NaN counts as the largest
        fresh = False
        if error <= 1.0:
            x[:] = stage
            k[0] = k[6]
            left -= step
            h = max(h, next_step(step, error)) if step < h else next_step(step, error)
            if left < SMALLEST * span:
                left = 0.0
        else:
            h = next_step(step, error) if error < 1e300 else 0.1 * step
            if not h > SMALLEST * span:
                return -1.0
    return h


@compiled
def advance_slopes(x, S, u, p, c, span, h, tolerance, k, stage, T, stage_S, J):
    """As `advance`, carrying S = d x / d(start state, free parameters), shape (NX, ND), along the same steps."""
    left = span
    fresh = True
    while left > 0.0:
        step = bounded(min(h, left), x, u, p, c)
        if fresh:
            slopes(x, u, p, c, k[0], J)
            push(J, S, T[0])
        for s in range(1, STAGES):
            for i in range(NX):
                total = 0.0
                for j in range(s):
                    total += A[s, j] * k[j, i]
                stage[i] = x[i] + step * total
                for d in range(ND):
                    stage_S[i, d] = S[i, d]
                for j in range(s):
                    weight = step * A[s, j]
                    if weight != 0.0:
                        for d in range(ND):
                            stage_S[i, d] += weight * T[j, i, d]
            slopes(stage, u, p, c, k[s], J)
            push(J, stage_S, T[s])
        error = 0.0
        for i in range(NX):
            total = 0.0
            for s in range(STAGES):
                total += E[s] * k[s, i]
            total = abs(step * total) / tolerance[i]
            error = total if not total <= error else error
        fresh = False
        if error <= 1.0:
            x[:] = stage
            S[:, :] = stage_S
            k[0] = k[6]
            T[0] = T[6]
            left -= step
            h = max(h, next_step(step, error)) if step < h else next_step(step, error)
            if left < SMALLEST * span:
                left = 0.0
        else:
            h = next_step(step, error) if error < 1e300 else 0.1 * step
            if not h > SMALLEST * span:
                return -1.0
    return h


@compiled
def simulate(first, last, starts, counts, X0, P, dt, U, tolerance, X, Y):
    """Free runs first..last-1: run w starts in state X0[w] at sample starts[w] and spans counts[w] intervals.

    X[w, n] and Y[w, n] receive states and outputs at its samples 0..counts[w]; NaN after a failure.
    """
    x, stage = np.empty(NX), np.empty(NX)
    k, c = np.empty((STAGES, NX)), np.empty(max(NC, 1))
    for w in range(first, last):
        p = P[w]
        constants(p, c)
        x[:] = X0[w]
        begin = starts[w]
        h = dt[begin] if counts[w] > 0 else 0.0
        for n in range(counts[w] + 1):
            m = begin + n
            X[w, n] = x
            sensors(x, U[m], p, c, Y[w, n])
            if n < counts[w]:
                h = advance(x, U[m], p, c, dt[m], h, tolerance, k, stage)
                if h < 0.0:
                    X[w, n + 1 :] = np.nan
                    Y[w, n + 1 :] = np.nan
                    break


@compiled
def normal_equations(
    first, last, starts, counts, closed, X0, p, dt, U, Y, weight, huber, tolerance, end, slope, H, g, cost
):
    """Gauss-Newton terms of windows first..last-1, all at the parameters p.

    Window w: the residuals (Y - y) * weight at its samples 0..counts-1 (also at its last one if closed[w]).
    Receives end[w] (NX,), slope[w] = d end / d(start, free) (NX, ND), H[w] = sum J'J (ND, ND), g[w] = sum J'r
    (ND,) with J = d y / d(start, free) * weight, and cost[w] = (sum of the loss, samples). NaN in Y is missing.
    Residuals beyond `huber` count linearly (Huber's loss; infinity for none). A failed window has cost NaN.
    """
    x, stage, y = np.empty(NX), np.empty(NX), np.empty(NY)
    k, c = np.empty((STAGES, NX)), np.empty(max(NC, 1))
    S, stage_S, T = np.empty((NX, ND)), np.empty((NX, ND)), np.empty((STAGES, NX, ND))
    R, J = np.empty((NY, ND)), np.empty(NNZ)
    constants(p, c)
    for w in range(first, last):
        x[:] = X0[w]
        S[:, :] = 0.0
        for i in range(NX):
            S[i, i] = 1.0
        H[w] = 0.0
        g[w] = 0.0
        loss = 0.0
        used = 0.0
        begin = starts[w]
        h = dt[begin] if counts[w] > 0 else 0.0
        for n in range(counts[w] + 1):
            m = begin + n
            if n < counts[w] or closed[w]:
                sensor_slopes(x, U[m], p, c, y, J)
                push_sensors(J, S, R)
                for o in range(NY):
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
                    square = scaled * weight[m, o]
                    for a in range(ND):
                        g[w, a] += R[o, a] * scaled * r
                        pivot = R[o, a] * square
                        if pivot != 0.0:
                            for b in range(a + 1):
                                H[w, a, b] += pivot * R[o, b]
            if n < counts[w]:
                h = advance_slopes(x, S, U[m], p, c, dt[m], h, tolerance, k, stage, T, stage_S, J)
                if h < 0.0:
                    loss = np.nan
                    break
        for a in range(ND):
            for b in range(a):
                H[w, b, a] = H[w, a, b]
        end[w] = x
        slope[w] = S
        cost[w, 0] = loss
        cost[w, 1] = used


@compiled
def objective(first, last, starts, counts, closed, X0, p, dt, U, Y, weight, huber, tolerance, end, cost):
    """The values alone of `normal_equations`: end[w] and cost[w], for judging a trial step."""
    x, stage, y = np.empty(NX), np.empty(NX), np.empty(NY)
    k, c = np.empty((STAGES, NX)), np.empty(max(NC, 1))
    constants(p, c)
    for w in range(first, last):
        x[:] = X0[w]
        loss = 0.0
        used = 0.0
        begin = starts[w]
        h = dt[begin] if counts[w] > 0 else 0.0
        for n in range(counts[w] + 1):
            m = begin + n
            if n < counts[w] or closed[w]:
                sensors(x, U[m], p, c, y)
                for o in range(NY):
                    r = (Y[m, o] - y[o]) * weight[m, o]
                    if r != r:
                        continue
                    loss += huber * (2.0 * abs(r) - huber) if abs(r) > huber else r * r
                    used += 1.0
            if n < counts[w]:
                h = advance(x, U[m], p, c, dt[m], h, tolerance, k, stage)
                if h < 0.0:
                    loss = np.nan
                    break
        end[w] = x
        cost[w, 0] = loss
        cost[w, 1] = used


@compiled
def trace(first, last, starts, counts, closed, X0, p, dt, U, tolerance, X, Y, G):
    """Outputs with their sensitivities at every sample: X (N, NX), Y (N, NY), G[n] = d y / d(start, free).

    Sample n belongs to the window that starts at or last before it; rows are those of the recording.
    """
    x, stage = np.empty(NX), np.empty(NX)
    k, c = np.empty((STAGES, NX)), np.empty(max(NC, 1))
    S, stage_S, T = np.empty((NX, ND)), np.empty((NX, ND)), np.empty((STAGES, NX, ND))
    J = np.empty(NNZ)
    constants(p, c)
    for w in range(first, last):
        x[:] = X0[w]
        S[:, :] = 0.0
        for i in range(NX):
            S[i, i] = 1.0
        begin = starts[w]
        h = dt[begin] if counts[w] > 0 else 0.0
        for n in range(counts[w] + 1):
            m = begin + n
            if n < counts[w] or closed[w]:
                X[m] = x
                sensor_slopes(x, U[m], p, c, Y[m], J)
                push_sensors(J, S, G[m])
            if n < counts[w]:
                h = advance_slopes(x, S, U[m], p, c, dt[m], h, tolerance, k, stage, T, stage_S, J)
                if h < 0.0:
                    break


__all__ = ["NU", "normal_equations", "objective", "simulate", "trace"]
