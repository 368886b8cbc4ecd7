"""Candidate pieces of a reference: each a few seconds within a range, at rest in its middle before and after."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from optid.core.model import Array
from optid.live.reference import TOUR

# s of a piece, approximately: long enough for a slow motion, short enough for several in a recording.
LENGTH = 3.0
STILL = 0.05  # share of a piece before it moves
REST = 0.15  # share of a piece after it has moved: the return to the middle, and rest there
INNER = 0.97  # share of the range that a reference uses: the axis may overshoot
PLAIN = 1.0  # s at each level of the plain experiment


@dataclass(frozen=True, eq=False)
class Piece:
    """Values of a reference, (samples,), m, and its description in a few words."""

    name: str
    reference: Array


@dataclass(frozen=True)
class Range:
    """The range of a reference: middle and largest distance to each side, m."""

    middle: float
    reach: float

    @staticmethod
    def of(low: float, high: float) -> Range:
        """Between two limits, with a margin."""
        return Range((low + high) / 2, INNER * (high - low) / 2)


def candidates(
    room: Range, samples: int, interval: float, generator: np.random.Generator
) -> tuple[Piece, ...]:
    """Pieces of every kind.

    Args:
        room: range of the reference.
        samples: of each piece.
        interval: time between samples, s.
        generator: of random levels and phases.
    """
    first, last = max(1, round(STILL * samples)), max(1, round(REST * samples))
    time = interval * np.arange(float(samples - first - last))

    def whole(name: str, move: Array) -> Piece:
        inside = np.clip(move, -room.reach, room.reach)
        return Piece(name, room.middle + np.r_[np.zeros(first), inside, np.zeros(last)])

    return tuple(whole(name, shape) for name, shape in _shapes(time, room.reach, generator))


def plain_steps(room: Range, samples: int, interval: float) -> Array:
    """The levels of `optid live`'s own tour, `PLAIN` seconds each: an experiment without a plan, (samples,)."""
    at = (interval * np.arange(samples) / PLAIN).astype(int) % (len(TOUR) - 1)
    return np.asarray(room.middle + room.reach * np.array(TOUR[1:])[at])


def _shapes(time: Array, reach: float, generator: np.random.Generator) -> Iterator[tuple[str, Array]]:
    """Names and distances from the middle, m."""
    span = float(time[-1])
    for share in (0.1, 0.3, 0.6, 1.0):
        for hold in (0.15, 0.4, 0.9):
            levels = share * reach * _levels(time, hold, generator)
            yield f"random steps, ±{100 * share:.0f} % of the reach, {hold:g} s each", levels
    for share, offset in ((0.05, 0.0), (0.3, 0.0), (1.0, 0.0), (0.3, 0.65), (0.3, -0.65)):
        where = "" if offset == 0.0 else f" about {offset:+.0%}"
        yield f"slow ramps, ±{100 * share:.0f} %{where}", reach * (offset + share * _triangle(time / span))
        yield f"fast ramps, ±{100 * share:.0f} %{where}", reach * (offset + share * _triangle(time / 0.5))
    for low, high, share in (
        (0.3, 3.0, 0.05),
        (0.3, 3.0, 0.3),
        (0.3, 3.0, 0.8),
        (1.0, 10.0, 0.3),
        (1.0, 10.0, 0.8),
        (5.0, 30.0, 0.3),
        (5.0, 30.0, 1.0),
    ):
        waves = share * reach * _multisine(time, low, high, generator)
        yield f"sines of {low:g} to {high:g} Hz, ±{100 * share:.0f} %", waves
    for half in (0.06, 0.12):
        yield f"fast square wave, ±100%, {half:g} s to each side", reach * _square(time, half)
    for name, sign in (("up first", 1.0), ("down first", -1.0)):
        yield f"full strokes, {name}", sign * reach * _square(time, span / 2)
    for size in (2e-4, 1e-3, 5e-3):
        yield f"small reversals, ±{1e3 * size:g} mm", size * _square(time, 0.4)
    for speed in (2e-3, 1e-2):
        yield f"slow motion at {1e3 * speed:g} mm/s", speed * span / 4 * _triangle(time / span)
    yield "holding still", np.zeros_like(time)


def _levels(time: Array, hold: float, generator: np.random.Generator) -> Array:
    """Random levels of -1 to 1; neighbours differ by at least a third, so that every one causes motion."""
    at = (time / hold).astype(int)
    levels = [0.0]
    while len(levels) < at[-1] + 2:
        level = float(generator.uniform(-1.0, 1.0))
        if abs(level - levels[-1]) > 1 / 3:
            levels.append(level)
    return np.asarray(np.array(levels[1:])[at])


def _triangle(cycles: Array) -> Array:
    """0, 1, 0, -1, 0 in straight lines over each cycle."""
    return np.asarray(2.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * cycles)))


def _square(time: Array, half: float) -> Array:
    """1 and -1 in turn, `half` seconds each."""
    return np.where((time / half).astype(int) % 2 == 0, 1.0, -1.0)


def _multisine(time: Array, low: float, high: float, generator: np.random.Generator) -> Array:
    """Sines of random phase over a band (Hz), falling with frequency, largest value 1, faded in and out."""
    span = float(time[-1])
    frequencies = (
        np.arange(np.ceil(low * span), np.floor(min(high, 0.4 * (len(time) - 1) / span) * span) + 1) / span
    )
    phases = generator.uniform(0.0, 2.0 * np.pi, len(frequencies))
    waves = np.sin(2.0 * np.pi * np.outer(time, frequencies) + phases) @ (1.0 / np.maximum(frequencies, low))
    fade = np.minimum(1.0, 10.0 * np.minimum(time, span - time) / span)
    return np.asarray(fade * waves / max(float(np.abs(fade * waves).max(initial=0.0)), 1e-12))
