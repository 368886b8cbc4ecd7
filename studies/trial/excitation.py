"""Wanted positions in two styles: "lively" as in references.py, and "calm": long holds, slow waves, triangles."""

from __future__ import annotations

import numpy as np

from studies.independent_rig.rig import Array
from studies.references import REFERENCES, Reference


def calm_steps(seconds: float, dt: float, rng: np.random.Generator, reach: float) -> Array:
    """Jumps to random places, each held for 0.6 to 1.3 s."""
    out = np.empty(round(seconds / dt))
    at = 0
    while at < len(out):
        hold = round(rng.uniform(0.6, 1.3) / dt)
        out[at : at + hold] = rng.uniform(-reach, reach)
        at += hold
    return out


def calm_waves(seconds: float, dt: float, rng: np.random.Generator, reach: float) -> Array:
    """Ten sines from 0.1 to 2.5 Hz, phases random, amplitudes falling with the root of the frequency."""
    t = np.arange(round(seconds / dt)) * dt
    frequencies = np.geomspace(0.1, 2.5, 10)
    phases = rng.uniform(0, 2 * np.pi, len(frequencies))
    wave = np.sin(2 * np.pi * np.outer(t, frequencies) + phases) @ (1 / np.sqrt(frequencies))
    return np.asarray(0.9 * reach * wave / np.abs(wave).max())


def triangles(seconds: float, dt: float, rng: np.random.Generator, reach: float) -> Array:
    """There and back at one speed of 30 to 90 mm/s, to turning points of their own near the reach."""
    t = np.arange(round(seconds / dt)) * dt
    speed = float(np.exp(rng.uniform(np.log(30e-3), np.log(90e-3))))
    number = 2 + int(seconds * speed / reach)
    turns = reach * rng.uniform(0.85, 1.0, number) * (-1.0) ** np.arange(number)
    corners = np.concatenate([[0.0], turns * rng.choice([-1.0, 1.0])])
    times = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(corners)) / speed)])
    return np.asarray(np.interp(t, times, corners))


def calm_mixed(seconds: float, dt: float, rng: np.random.Generator, reach: float) -> Array:
    """A third of steps, then a sine that sweeps down from 0.6 to 1.2 Hz to a third of that."""
    jumps = calm_steps(seconds / 3, dt, rng, reach)
    t = np.arange(round(seconds / dt) - len(jumps)) * dt
    start = rng.uniform(0.6, 1.2)
    phase = 2 * np.pi * start * (t - t**2 / (3 * max(t[-1], dt)))
    grow = reach * np.linspace(rng.uniform(0.5, 0.8), 1.0, len(t))
    return np.concatenate([jumps, grow * np.sin(phase + rng.uniform(0, 2 * np.pi))])


STYLES: dict[str, dict[str, Reference]] = {
    "lively": REFERENCES,
    "calm": {"steps": calm_steps, "multisine": calm_waves, "ramps": triangles, "mixed": calm_mixed},
}
