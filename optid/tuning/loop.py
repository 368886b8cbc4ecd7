"""The closed loop, compiled: the rig's own controller around the identified model, limits and all.

Candidates run four at a time through the same samples: their long chains of dependent operations overlap.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from optid.core.model import Array
from optid.core.threads import parallel_for
from optid.errors import InputError
from optid.pid import pid_step as memory_layout
from optid.pid.pid_step import GAINS, MEMORY, law
from optid.tuning.criterion import Criterion
from optid.tuning.machine import compiled
from optid.tuning.plant import Plant
from optid.tuning.scenarios import Episode

LANES = 4
HUNTING = 3  # place of the hunting among the parts of a cost
# Of a cost: the measure, travel of the command in units of its range, overshoot as a share of the step, and the
# output's peak to peak while it should be at rest.
PARTS = 4
ESCAPED = 1e6  # times the reference: an output this far away has diverged, and is not simulated further
_LAST = memory_layout.LAST_COMMAND


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """Plants, episodes and a criterion as arrays, made once and run for many gains.

    Attributes:
        plants: a controller must work with all of them; the first one is the model itself.
        episodes: all of one length.
        criterion: summed over an episode.
        settings: of the controller, as `Settings.vector` gives them.
        command_size: range of the command, the unit of travel.
    """

    plants: tuple[Plant, ...]
    episodes: tuple[Episode, ...]
    criterion: Criterion
    settings: Array
    command_size: float

    def __post_init__(self) -> None:
        lengths = {episode.reference.size for episode in self.episodes}
        if len(lengths) != 1:
            raise InputError(
                f"{sorted(lengths)} samples", field="episodes", expected="one or more, of one length"
            )
        times = {plant.sample_time for plant in self.plants}
        own = float(self.settings[memory_layout.SAMPLE_TIME - GAINS])
        if times != {own}:
            raise InputError(
                f"{own:g} s, the model's is {next(iter(times)):g} s",
                field="sample_time",
                expected="a controller that runs at the model's sample time",
                hint="identify the model at the rate the controller will run at",
            )
        order = max(plant.a.size for plant in self.plants)
        stack = {
            "A": _padded([plant.a for plant in self.plants], order),
            "B": _padded([plant.b for plant in self.plants], order),
            "R": np.array([e.reference for e in self.episodes]),
            "D": np.array([e.load for e in self.episodes]),
            "O": np.array([e.rise for e in self.episodes]),
            "N": np.array([e.noise for e in self.episodes]),
            "S": np.array([float(e.rest) for e in self.episodes]),
            "Z": np.array([plant.dead_zone for plant in self.plants]),
            "W": np.array([self.criterion.measure.weights(e.clock, own) for e in self.episodes]),
        }
        for name, values in stack.items():
            object.__setattr__(self, f"_{name}", np.ascontiguousarray(values))

    @property
    def arrays(self) -> tuple[Array, ...]:
        """A, B (plants, order), Z (plants, 2), R, D, W, O, N (episodes, samples), S (episodes,): for the loop."""
        return tuple(getattr(self, f"_{name}") for name in "ABZRDWONS")

    def parts(self, gains: Array) -> Array:
        """Parts of the cost of gains (candidates, GAINS): shape (candidates, plants, episodes, PARTS)."""
        gains = np.atleast_2d(gains)
        out = np.empty((len(gains), len(self.plants), len(self.episodes), PARTS))
        square, size = self.criterion.measure.power == 2, 1.0 / self.command_size

        def run(first: int, last: int) -> None:
            start, stop = LANES * first, min(LANES * last, len(gains))
            _batch(gains, self.settings, self.arrays, square, size, start, stop, out)

        parallel_for(-(-len(gains) // LANES), run)
        return out

    def costs(self, gains: Array) -> Array:
        """Cost of each candidate by plant, shape (candidates, plants): the weighted sum over the episodes."""
        return self.judged(gains)[0]

    def judged(self, gains: Array) -> tuple[Array, Array]:
        """Of each candidate by plant, shape (candidates, plants): cost, and the largest hunting (output's unit)."""
        weights = np.array([episode.weight for episode in self.episodes])
        parts = self.parts(gains)
        hunting = np.nan_to_num(parts[..., HUNTING], nan=np.inf).max(axis=-1)
        if self.criterion.own is None:
            return np.asarray(self.criterion.combined(parts) @ weights), hunting
        own = [[self._own(g, k) @ weights for k in range(len(self.plants))] for g in np.atleast_2d(gains)]
        return np.array(own), hunting

    def _own(self, gains: Array, plant: int) -> Array:
        assert self.criterion.own is not None
        time: Array = self.plants[0].sample_time * np.arange(float(self.episodes[0].reference.size))
        found = []
        for number, episode in enumerate(self.episodes):
            y, u = self.trace(gains, plant, number)
            with np.errstate(all="ignore"):
                value = (
                    float(self.criterion.own(time, episode.reference - y, u))
                    if np.isfinite(y).all()
                    else np.inf
                )
            found.append(value if np.isfinite(value) else np.inf)
        return np.array(found)

    def trace(self, gains: Array, plant: int = 0, episode: int = 0) -> tuple[Array, Array]:
        """Output and command at every sample, each of shape (samples,); NaN once the output has diverged."""
        A, B, Z, R, D, _, _, N, _ = self.arrays
        y, u = np.empty(R.shape[1]), np.empty(R.shape[1])
        one = R[episode], D[episode], N[episode]
        _trace(np.r_[gains, self.settings], A[plant], B[plant], Z[plant], one, y, u)
        return y, u


def _padded(rows: Sequence[Array], size: int) -> Array:
    return np.array([np.pad(row, (0, size - row.size)) for row in rows])


@compiled
def _batch(
    gains: Any, settings: Any, arrays: Any, square: Any, size: Any, first: Any, last: Any, out: Any
) -> None:
    """Candidates first..last-1; the lanes left over at the end repeat the last one."""
    A, B, Z, R, D, W, rise, N, rest_from = arrays
    s = np.empty((GAINS + settings.size, LANES))
    m, z, parts = np.empty((MEMORY, LANES)), np.empty((A.shape[1] + 1, LANES)), np.empty((PARTS, LANES))
    low, high = np.empty(LANES), np.empty(LANES)
    rest = min(max(0.0, settings[1]), settings[2])
    for group in range(first, last, LANES):
        for lane in range(LANES):
            g = min(group + lane, last - 1)
            for i in range(GAINS):
                s[i, lane] = gains[g, i]
            for i in range(settings.size):
                s[GAINS + i, lane] = settings[i]
        for k in range(A.shape[0]):
            for e in range(R.shape[0]):
                m[:] = 0.0
                m[_LAST] = rest
                z[:] = 0.0
                parts[:] = 0.0
                low[:], high[:] = np.inf, -np.inf
                one = R[e], D[e], W[e], rise[e], N[e]
                _lanes(s, A[k], B[k], Z[k], one, rest_from[e], square, m, z, parts, low, high)
                for lane in range(min(LANES, last - group)):
                    out[group + lane, k, e, 0] = parts[0, lane]
                    out[group + lane, k, e, 1] = parts[1, lane] * size
                    out[group + lane, k, e, 2] = parts[2, lane]
                    out[group + lane, k, e, HUNTING] = max(high[lane] - low[lane], 0.0)


@compiled
def _lanes(
    s: Any,
    a: Any,
    b: Any,
    dead: Any,
    episode: Any,
    rest: Any,
    square: Any,
    m: Any,
    z: Any,
    parts: Any,
    low: Any,
    high: Any,
) -> None:
    """One episode of one plant: z is the plant's memory in transposed direct form, one sample ahead."""
    reference, load, weight, rise, noise = episode
    order = a.size
    for n in range(reference.size):
        r, d, w, o = reference[n], load[n], weight[n], rise[n]
        for lane in range(LANES):
            y, before = z[0, lane], m[_LAST, lane]
            u = law(s[:, lane], m[:, lane], r, y + noise[n])
            error = abs(r - y)
            parts[0, lane] += w * (error * error if square else error)
            parts[1, lane] += abs(u - before)
            parts[2, lane] = max(parts[2, lane], (y - r) * o)
            if n >= rest:
                low[lane], high[lane] = min(low[lane], y), max(high[lane], y)
            x = passed(u + d, dead)
            for i in range(order):
                z[i, lane] = z[i + 1, lane] + b[i] * x - a[i] * y


@compiled
def passed(command: Any, dead: Any) -> Any:
    """The part of a command that passes a dead zone from dead[0] (at most 0) to dead[1] (at least 0)."""
    return command - min(max(command, dead[0]), dead[1])


@compiled
def _trace(s: Any, a: Any, b: Any, dead: Any, episode: Any, y: Any, u: Any) -> None:
    reference, load, noise = episode
    m, z = np.zeros(MEMORY), np.zeros(a.size + 1)
    m[_LAST] = min(max(0.0, s[GAINS + 1]), s[GAINS + 2])
    bound = ESCAPED * (np.max(np.abs(reference)) + np.max(np.abs(load)))
    for n in range(reference.size):
        y[n] = z[0]
        u[n] = law(s, m, reference[n], y[n] + noise[n])
        if not abs(y[n]) <= bound:
            y[n:] = np.nan
            u[n:] = np.nan
            return
        x = passed(u[n] + load[n], dead)
        for i in range(a.size):
            z[i] = z[i + 1] + b[i] * x - a[i] * y[n]
