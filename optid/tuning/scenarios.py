"""Scenarios of the loop: set-points, profiles, loads; each an episode that starts at rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from optid.core.model import Array
from optid.errors import InputError

NEVER = 1 << 62


@dataclass(frozen=True, eq=False)
class Episode:
    """One run of the loop, from rest at zero; all arrays have shape (samples,).

    Attributes:
        name: for tables and figures.
        reference: wanted output, output's unit.
        load: disturbance added to the command, command's unit.
        clock: time since the last change of the reference, s: the T of ITAE.
        rise: 1 / (change of the reference) for the overshoot after a step, 0 where none is evaluated.
        weight: of this episode's criterion in the sum.
        noise: of the sensor that the controller sees, output's unit; none where left out.
        variant: number of the physical model's parameter set that runs it, 0 the nominal one.
        rest: sample from which the output should be at rest; `samples` or more where it need not be.
        gain: factor on the plant's command: a loop that tolerates it has that gain margin.
        nominal: nominal size of the step in tables, output's unit; 0 for its own size.
        run: number of the run it belongs to; negative where it belongs to all.
    """

    name: str
    reference: Array
    load: Array
    clock: Array
    rise: Array
    weight: float = 1.0
    noise: Array = field(default_factory=lambda: np.empty(0))
    variant: int = 0
    rest: int = NEVER
    gain: float = 1.0
    nominal: float = 0.0
    run: int = -1

    def __post_init__(self) -> None:
        if not self.noise.size:
            object.__setattr__(self, "noise", np.zeros(self.reference.shape))
        for name in ("reference", "load", "clock", "rise", "noise"):
            values = getattr(self, name)
            if values.shape != self.reference.shape or values.ndim != 1 or not values.size:
                raise InputError(f"shape {values.shape}", where=self.name, field=name, expected="(samples,)")
            if not np.all(np.isfinite(values)):
                raise InputError("a value is not finite", where=self.name, field=name)

    @property
    def size(self) -> float:
        """Largest reference or, without one, 0; output's unit."""
        return float(np.max(np.abs(self.reference)))


def step(size: float, samples: int, sample_time: float, weight: float = 1.0) -> Episode:
    """A set-point step from rest at the first sample.

    Args:
        size: of the step, output's unit, not 0.
        samples: of the episode.
        sample_time: s.
        weight: of the episode.
    """
    return moves([(0.0, size)], samples, sample_time, weight)


def moves(
    targets: Sequence[tuple[float, float]], samples: int, sample_time: float, weight: float = 1.0
) -> Episode:
    """A sequence of positions, each from its time (s) on; ITAE's clock restarts at each.

    Raises:
        InputError: a target equal to the one before, or times that do not increase.
    """
    reference, clock, rise = np.zeros(samples), np.zeros(samples), np.zeros(samples)
    last, before = 0.0, -1
    for time, target in targets:
        at = round(time / sample_time)
        if not before < at < samples:
            raise InputError(
                f"a move at {time:g} s", field="moves", expected="rising times within the episode"
            )
        before = at
        reference[at:] = target
        clock[at:] = sample_time * np.arange(samples - at)
        rise[at:] = 1.0 / (target - last) if target != last else 0.0
        last = target
    if not np.any(rise):
        raise InputError("the set-point equals the present output", field="setpoint", expected="a move")
    name = " → ".join(f"{target:g}" for _, target in targets)
    return Episode(f"step to {name}", reference, np.zeros(samples), clock, rise, weight)


def profile(reference: ArrayLike, sample_time: float, name: str = "profile", weight: float = 1.0) -> Episode:
    """A set-point profile, shape (samples,); all times have equal weight, that of half the episode in ITAE.

    The profile is relative to its first value.
    """
    path = np.asarray(reference, dtype=float)
    path = path - path[0] if path.size else path
    if not np.any(path):
        raise InputError("the set-point never changes", where=name, field="profile", expected="a path")
    clock = np.full(path.size, 0.5 * path.size * sample_time)
    return Episode(name, path, np.zeros(path.size), clock, np.zeros(path.size), weight)


def load(size: float, samples: int, sample_time: float, weight: float = 1.0) -> Episode:
    """A load: a step added to the plant's command from the first sample on; the output should stay."""
    zeros = np.zeros(samples)
    if size == 0.0:
        raise InputError("0", field="disturbance", expected="a load that is not zero")
    clock: Array = sample_time * np.arange(float(samples))
    return Episode(f"load {size:g}", zeros, np.full(samples, float(size)), clock, zeros.copy(), weight)
