"""Wanted positions for recordings: steps, a multisine, slow ramps, and all three in turn; no dither in any.

Each function: (seconds, dt, rng, reach) -> positions, m, shape (n,), within +- reach.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Reference = Callable[[float, float, np.random.Generator, float], Array]


def steps(seconds: float, dt: float, rng: np.random.Generator, reach: float = 0.1) -> Array:
    """Jumps to random places, each held for 0.3 to 0.9 s."""
    out = np.empty(round(seconds / dt))
    at = 0
    while at < len(out):
        hold = round(rng.uniform(0.3, 0.9) / dt)
        out[at : at + hold] = rng.uniform(-reach, reach)
        at += hold
    return out


def multisine(seconds: float, dt: float, rng: np.random.Generator, reach: float = 0.1) -> Array:
    """Sixteen sines from 0.2 to 8 Hz, phases random, amplitudes falling with the root of the frequency."""
    t = np.arange(round(seconds / dt)) * dt
    frequencies = np.geomspace(0.2, 8.0, 16)
    phases = rng.uniform(0, 2 * np.pi, len(frequencies))
    wave = np.sin(2 * np.pi * np.outer(t, frequencies) + phases) @ (1 / np.sqrt(frequencies))
    return np.asarray(0.9 * reach * wave / np.abs(wave).max())


def ramps(seconds: float, dt: float, rng: np.random.Generator, reach: float = 0.1) -> Array:
    """Ramps of 3 to 80 mm/s up and down in turn, with pauses of 0.2 s, where dry friction shows."""
    out = np.empty(round(seconds / dt))
    level, at, way = 0.0, 0, rng.choice([-1.0, 1.0])
    while at < len(out):
        speed = way * float(np.exp(rng.uniform(np.log(3e-3), np.log(80e-3))))
        move, pause = round(rng.uniform(0.4, 1.2) / dt), round(0.2 / dt)
        path = np.clip(level + speed * dt * np.arange(1, move + 1), -reach, reach)
        piece = np.concatenate([path, np.full(pause, path[-1])])[: len(out) - at]
        out[at : at + len(piece)] = piece
        level, at, way = float(path[-1]), at + len(piece), -way
    return out


def mixed(seconds: float, dt: float, rng: np.random.Generator, reach: float = 0.1) -> Array:
    """A third of the time each: steps, a multisine, ramps that begin where the multisine ended."""
    third = seconds / 3
    jumps, waves = steps(third, dt, rng, reach), multisine(third, dt, rng, reach)
    rest = seconds - (len(jumps) + len(waves)) * dt
    slow = ramps(rest, dt, rng, 0.5 * reach) + float(np.clip(waves[-1], -0.5 * reach, 0.5 * reach))
    return np.concatenate([jumps, waves, slow])


REFERENCES: dict[str, Reference] = {"steps": steps, "multisine": multisine, "ramps": ramps, "mixed": mixed}
