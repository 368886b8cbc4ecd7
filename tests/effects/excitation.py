"""Runs of the servo-pneumatic axis: a rich one under control, and full strokes at full command."""

from functools import lru_cache

import numpy as np

from optid.core.model import CLOCK, INTERVAL
from optid.core.simulation import simulate
from tests.effects.plants import grown

RATE, SECONDS = 1000, 10
DT = 1.0 / RATE
N = RATE * SECONDS
# (seconds, m): moves there within that time, then holds for 0.25 s; the last two run into both cushions at full speed.
MOVES = (
    (1.0, 0.012),
    (0.6, -0.02),
    (0.3, 0.07),
    (0.3, -0.06),
    (0.15, 0.03),
    (1.2, 0.034),
    (0.4, 0.1),
    (0.5, -0.1),
    (0.15, 0.0),
    (0.25, 0.128),
    (0.4, -0.128),
)
GAIN, BINARY, HOLD = 25.0, 0.02, 10  # 1/m, share of full command, samples


def reference():
    """Positions to follow, m, (N,)."""
    parts, at = [], 0.0
    for seconds, to in MOVES:
        s = np.linspace(0.0, 1.0, round(seconds * RATE))
        parts.append(at + (to - at) * (10 * s**3 - 15 * s**4 + 6 * s**5))
        parts.append(np.full(round(0.25 * RATE), to))
        at = to
    joined = np.concatenate(parts)
    return np.r_[joined, np.full(N, at)][:N]


def inputs_of(model, u):
    """Inputs of a model for a command, (N, inputs)."""
    t = np.arange(len(u)) * DT
    made = {INTERVAL: np.full(len(u), DT), CLOCK: t + DT / 2}
    columns = [made.get(port.role, np.r_[np.full(port.ago, u[0]), u][: len(u)]) for port in model.inputs]
    return np.column_stack(columns)


@lru_cache(maxsize=1)
def strokes():
    """The plain axis at full command to and fro: states (N, states) and command (N,)."""
    plant = grown("servo-pneumatic")
    model, p = plant.plain, plant.plain.vector(plant.values)
    u = np.where(np.arange(N) % RATE < RATE // 2, 1.0, -1.0)
    start = np.array(model.start(p)[0]).ravel()
    return simulate(model, p, start, np.full(N, DT), u[:, None]).states[0], u


@lru_cache(maxsize=1)
def run():
    """The plain axis under a proportional controller: states (N, states) and command (N,)."""
    plant = grown("servo-pneumatic")
    model, p, rng = plant.plain, plant.plain.vector(plant.values), np.random.default_rng(7)
    ref, binary = reference(), BINARY * np.repeat(rng.choice([-1.0, 1.0], N // HOLD + 1), HOLD)
    u, X = np.empty(N), np.empty((N, len(model.states)))
    x = np.array(model.start(p)[0]).ravel()
    dt = np.full(HOLD + 1, DT)
    for k in range(0, N, HOLD):
        block = np.clip(GAIN * (ref[k : k + HOLD] - x[0]) + binary[k : k + HOLD], -1.0, 1.0)
        u[k : k + HOLD] = block
        states = simulate(model, p, x, dt, np.r_[block, block[-1]][:, None]).states[0]
        X[k : k + HOLD], x = states[:-1], states[-1]
    return X, u
