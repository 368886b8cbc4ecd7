"""What each effect writes into a recording that base parameters and window starts cannot: its signature.

All effects are replayed along the same recording, window by window, from the plain rig's states; what an effect
remembers (spool, plays, deflections) is settled over the samples before the window first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from studies.independent_rig import Controller, Rig, Run, replay, simulate
from studies.independent_rig.rig import Array
from studies.independent_rig.states import CREEP_A, CREEP_B, PA, PB, WAY, V, X
from studies.references import REFERENCES
from studies.trial.case import NOMINAL, Hidden, with_effects
from studies.trial.concealment import BASE, NUDGES, STEP, WINDOW, moved
from studies.trial.record import DT

SETTLE = 200  # samples
LIMIT = Controller().limit
OWN = (X, V, PA, PB, WAY, CREEP_A, CREEP_B)  # what the plain rig has, too, and a window begins with
ENDS = 0.127  # m: a reach at which the ends are met


@dataclass(frozen=True)
class Sight:
    """A recording to look at: its run with the plain rig, and the noise of its sensors (sd, m and Pa or None)."""

    run: Run
    position_noise: float = 0.03e-3
    pressure_noise: float | None = 500.0

    def scaled(self, clean: Array, states: Array) -> Array:
        """Measured channels in sd, (samples, channels)."""
        channels = [clean / self.position_noise]
        if self.pressure_noise is not None:
            channels += [states[:, PA] / self.pressure_noise, states[:, PB] / self.pressure_noise]
        return np.stack(channels, axis=1)


def excited(kind: str, seconds: float, rng: np.random.Generator, reach: float = 0.1) -> Run:
    """The plain rig along a reference: one of REFERENCES, "strokes" to the ends, or a "sine" of 0.5 Hz and 80 mm."""
    if kind == "sine":
        reference = 0.08 * np.sin(np.pi * np.arange(round(seconds / DT)) * DT)
    elif kind == "strokes":
        reference = ENDS * np.sign(np.sin(2 * np.pi * 0.6 * np.arange(round(seconds / DT)) * DT + 0.1))
    else:
        reference = REFERENCES[kind](seconds, DT, rng, reach)
    return simulate(Rig(**NOMINAL), reference, rng, step=STEP)


class Projector:
    """Takes out of a signature what a refit of the base parameters and the window starts would."""

    def __init__(self, sights: list[Sight]) -> None:
        self.sights = sights
        self.starts = [(s, first) for s in sights for first in range(SETTLE, len(s.run.t) - WINDOW, WINDOW)]
        rig = Rig(**NOMINAL)
        self.plain = [_window(s, rig, first, {}) for s, first in self.starts]
        self.local = [
            np.linalg.qr(
                np.stack([_window(s, rig, first, {k: much}) - plain for k, much in NUDGES.items()], axis=1)
            )[0]
            for (s, first), plain in zip(self.starts, self.plain, strict=True)
        ]
        tangents = [self.raw(rig._replace(**{name: 1.02 * getattr(rig, name)})) for name in BASE]
        self.shared = np.linalg.qr(np.stack([self._locally(t) for t in tangents], axis=1))[0]

    def raw(self, rig: Rig) -> list[Array]:
        """What `rig` does otherwise than the plain one, by window."""
        return [
            _window(s, rig, first, {}) - plain
            for (s, first), plain in zip(self.starts, self.plain, strict=True)
        ]

    def _locally(self, blocks: list[Array]) -> Array:
        return np.concatenate([b - q @ (q.T @ b) for b, q in zip(blocks, self.local, strict=True)])

    def signature(self, hidden: Hidden) -> Array:
        """In sd, (rows,): its norm is how many sd the best test sees of the effect."""
        rest = self._locally(self.raw(with_effects(Rig(**NOMINAL), (hidden,))))
        return np.asarray(rest - self.shared @ (self.shared.T @ rest))


def _window(sight: Sight, rig: Rig, first: int, by: dict[int, float]) -> Array:
    """Measured channels over a window that begins at the plain rig's state (moved by `by`), stacked, in sd."""
    share = sight.run.command / LIMIT
    before, begin = sight.run.states[first - SETTLE], sight.run.states[first]
    y = replay(rig, share, before, first - SETTLE, SETTLE + 1, step=STEP)[0][-1]
    # What the effect remembers stands relative to where it has come in the meantime.
    shift = begin[X] - y[X]
    y = moved(y, {X: shift})
    y[list(OWN)] = begin[list(OWN)]
    states, clean = replay(rig, share, moved(y, by), first, WINDOW, step=STEP)
    return sight.scaled(clean, states).T.ravel()
