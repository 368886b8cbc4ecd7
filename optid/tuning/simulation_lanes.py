"""Closed loops on a physical model, several at a time: each lane has its own gains, episode and parameters.

All lanes take the same linearly implicit steps (`optid.core.rosenbrock`), so friction at rest does not limit their
length. Only the parts of the cost are kept: no trajectory is stored.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from optid.core.kernel import advance_many, at, call
from optid.core.llvm_simd import LANES
from optid.pid.pid_step import GAINS, LAST_COMMAND, MEMORY, law
from optid.tuning.loop import HUNTING
from optid.tuning.machine import compiled


@compiled
def measured(
    code: Any, s: Any, T: Any, plant: Any, feeds: Any, share: Any, episodes: Any, square: Any, parts: Any
) -> bool:
    """Run `LANES` closed loops; false where they could not advance together (one of them has diverged).

    Args:
        code: machine code of the model (`optid.core.jit.compiled_lanes`).
        s: gains and settings of each lane's controller, (LANES, SETTINGS).
        T: sample time, s.
        plant: start states (LANES, states), parameters (LANES, parameters), tolerance (states,), number of outputs and
            the controlled one.
        feeds: source of each input of the model: the command, delayed by this many samples, -1 the interval, -2 the
            clock.
        share: model's command per controller's command in each lane, (LANES,).
        episodes: reference, load, noise, weight of the error, rise, each (LANES, samples), and the sample from which
            each should be at rest, (LANES,).
        square: whether the measure squares the error.
        parts: receives the parts of each lane's cost, (LANES, PARTS).
    """
    start, P, tolerance, outputs, column = plant
    reference, _, _, _, _, rest = episodes
    nx, nu = start.shape[1], feeds.size
    c, cs = np.empty((LANES, code.hoisted)), np.empty((code.hoisted, LANES))
    us, xs = np.empty((nu + 1, LANES)), np.empty((nx, LANES))
    room = np.empty(nx), np.zeros(nu), np.empty(outputs + 1)
    m, zero = np.zeros((LANES, MEMORY)), np.zeros(LANES)
    past = np.empty((LANES, max(feeds.max(), 0) + 1))
    low, high = np.full(LANES, np.inf), np.full(LANES, -np.inf)
    h = 0.1 * T
    parts[:] = 0.0
    _begin(code, s, start, P, share, c, cs, xs, m, past)
    for n in range(reference.shape[1]):
        for lane in range(LANES):
            y = _sensed(code, xs, c, (n, lane, column, T), feeds, past, room)
            if n == 0:
                zero[lane] = y
            y -= zero[lane]
            if not np.isfinite(y):
                return False
            command = _controlled(s[lane], m[lane], (n, lane), episodes, y, square, parts[lane])
            if n >= rest[lane]:
                low[lane], high[lane] = min(low[lane], y), max(high[lane], y)
            _hold(command * share[lane], lane, feeds, past, room[1], us)
        h = advance_many(
            code.many_step, code.many_half, at(xs, 0), at(us, 0), at(cs, 0), at(tolerance, 0), T, min(h, T)
        )
        if h < 0.0:
            return False
    for lane in range(LANES):
        parts[lane, HUNTING] = max(high[lane] - low[lane], 0.0)
    return True


@compiled
def _begin(
    code: Any, s: Any, start: Any, P: Any, share: Any, c: Any, cs: Any, xs: Any, m: Any, past: Any
) -> None:
    """States, constants and memories before the first sample."""
    for lane in range(LANES):
        call(code.constants, (at(P, lane * P.shape[1]), at(c, lane * c.shape[1])))
        for i in range(c.shape[1]):
            cs[i, lane] = c[lane, i]
        for i in range(start.shape[1]):
            xs[i, lane] = start[lane, i]
        m[lane, LAST_COMMAND] = min(max(0.0, s[lane, GAINS + 1]), s[lane, GAINS + 2])
        for j in range(past.shape[1]):
            past[lane, j] = m[lane, LAST_COMMAND] * share[lane]


@compiled
def _sensed(code: Any, xs: Any, c: Any, when: Any, feeds: Any, past: Any, room: Any) -> float:
    """The controlled output of one lane; `room` stores the held values of its inputs."""
    x, held, out = room
    n, lane, column, T = when
    for j in range(feeds.size):
        held[j] = T if feeds[j] == -1 else (n + 0.5) * T if feeds[j] == -2 else past[lane, feeds[j]]
    for i in range(x.size):
        x[i] = xs[i, lane]
    none = at(x, 0)  # the placeholder for slopes is never used
    call(code.sensors, (at(x, 0), none, at(held, 0), at(c, lane * c.shape[1]), at(out, 0), none))
    return out[column]  # type: ignore[no-any-return]


@compiled
def _controlled(s: Any, m: Any, when: Any, episodes: Any, y: Any, square: Any, parts: Any) -> float:
    """One lane's command with its disturbance, and its part of the cost."""
    reference, load, noise, weight, rise, _ = episodes
    n, lane = when
    r, before = reference[lane, n], m[LAST_COMMAND]
    u = law(s, m, r, y + noise[lane, n])
    error = abs(r - y)
    parts[0] += weight[lane, n] * (error * error if square else error)
    parts[1] += abs(u - before)
    parts[2] = max(parts[2], (y - r) * rise[lane, n])
    return u + load[lane, n]  # type: ignore[no-any-return]


@compiled
def _hold(command: Any, lane: Any, feeds: Any, past: Any, held: Any, us: Any) -> None:
    """The inputs of the model until the next sample."""
    for j in range(past.shape[1] - 1, 0, -1):
        past[lane, j] = past[lane, j - 1]
    past[lane, 0] = command
    for j in range(feeds.size):
        us[j, lane] = past[lane, feeds[j]] if feeds[j] >= 0 else held[j]
