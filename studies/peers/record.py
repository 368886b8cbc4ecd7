"""The record that every route of the speed benchmark fits: 10 s at 1 kHz, three unknown parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from studies.peers import fit_c
from studies.peers.axis import TRUE, Array

FULL_SCALE = 5.0  # V
NOISE = 20e-6  # m
# Within a factor 2 of the truth, on both sides of it.
START = {"viscous_friction": 120.0, "coulomb_friction": 55.0, "discharge_coefficient": 0.55}


@dataclass(frozen=True)
class Record:
    """A recording with everything a fit may know and the truth it may not.

    Attributes:
        dt: sample time, s.
        command: recorded command, V, held to the next sample, shape (n,).
        position: measured position, m, shape (n,).
        start_state: x, v, P_a, P_b at the first sample, SI: given to every route.
        truth: true parameters, SI.
        guess: the same with the start values of the three unknown ones.
        states: noise-free states at the samples, shape (n, 4), for checks.
    """

    dt: float
    command: Array
    position: Array
    start_state: Array
    truth: dict[str, float]
    guess: dict[str, float]
    states: Array

    @property
    def share(self) -> Array:
        """Command as a share of full scale."""
        return self.command / FULL_SCALE


def benchmark_record(
    seed: int = 1, seconds: float = 10.0, dt: float = 1e-3, truth: Mapping[str, float] = TRUE
) -> Record:
    """Simulate the first `seconds` (at most 10) of the record, in steps ten times finer than the routes take.

    A proportional controller follows steps, then a multisine, then ramps; the command is quantised to 12 bits
    and recorded as applied. The true positions are right to a nanometre; steps of 0.5 ms stay within 0.2
    micrometres of them (near full command the chambers' fast equalisation would want shorter ones).
    """
    rng = np.random.default_rng(seed)
    n = round(seconds / dt)
    wanted = reference(np.arange(round(10.0 / dt)) * dt, rng)
    state = np.array([0.0, 0.0, 4.2e5, 4.8e5])
    # Let the pressures settle at rest first, so that the record starts in a state a rig can have.
    for _ in range(500):
        state = fit_c.simulate(truth, state, np.array([-8.0 * state[0]]), dt, 20)[-1]
    states, commands = np.empty((n, 4)), np.empty(n)
    for k in range(n):
        states[k] = state
        wish = 5.0 * (wanted[k] - state[0]) - 0.02 * state[1]
        commands[k] = np.clip(np.round(wish * 2048) / 2048, -1.0, 1.0)
        state = fit_c.simulate(truth, state, commands[k : k + 1], dt, 20)[-1]
    position = states[:, 0] + rng.normal(0.0, NOISE, n)
    return Record(dt, commands * FULL_SCALE, position, states[0], dict(truth), {**truth, **START}, states)


def reference(t: Array, rng: np.random.Generator) -> Array:
    """Wanted position, m: a third of the time each steps of 0.4 s, a multisine of 0.3 to 8 Hz, and ramps."""
    third = t[-1] / 3
    levels = rng.uniform(-0.065, 0.065, int(third / 0.4) + 1)
    steps = levels[np.minimum((t / 0.4).astype(int), len(levels) - 1)]
    frequencies = np.geomspace(0.3, 8.0, 12)
    phases = rng.uniform(0, 2 * np.pi, 12)
    sines = np.sin(2 * np.pi * np.outer(t, frequencies) + phases) @ (0.021 / np.sqrt(frequencies))
    knots = np.linspace(2 * third, t[-1], 7)
    ramps = np.interp(t, knots, rng.uniform(-0.065, 0.065, 7))
    return np.clip(np.where(t < third, steps, np.where(t < 2 * third, sines, ramps)), -0.075, 0.075)
