"""The steps by which gains are judged: several sizes in both directions, several seeds of the sensor's noise.

One step of one size gives little information on an axis with dry friction: it may or may not stick at the target.
Smaller steps are always added. The first run has exactly these sizes, and no noise where a linear model judges;
dry friction acts differently without the dither of noise, so there it has noise as well. In each other run all steps
are shortened by random shares, and the noise is new: where an axis with dry friction comes to rest depends on the
step's size almost randomly, and gains must be good for all sizes, not for seven. In a third of these steps the plant
has a larger gain, so that the gains found tolerate it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from optid.tuning.scenarios import Episode, step

SHARES = (1.0, -1.0, 0.75, -0.5, 0.25, -0.25, 0.125)  # of the largest step
REST = 0.5  # share of an episode, at its end, during which the output should be at rest: slips come late
HUNTING_OVER_NOISE = 3.0  # peak to peak at rest that does not count as hunting, in sd of the sensor's noise
HUNTING_SHARE = 1e-3  # the same as a share of the largest step, where the noise is smaller
SEED = 20  # of the noise
SHORTER = 0.25  # largest share by which a step is shortened in a run
STRIDE = 0.37  # between the shares of neighbouring sizes
# Factor on the command in one of so many steps: a gain margin with friction and limits.
STRONGER, EVERY = 1.1, 3


@dataclass(frozen=True)
class StepPlan:
    """The plan of step tests.

    Attributes:
        sizes: output's unit; the first one is that to which the costs of the others are scaled.
        samples: of each episode.
        sample_time: s.
        noise: sd of the sensor, output's unit.
        runs: of each size; the first one with the nominal plant.
        quiet: whether the first one has no noise.
        variants: further parameter sets of the physical model, used by the runs in turn.
        load: constant load added to the command.
        power: of the error in the criterion, for the scaling.
        stronger: factor on the command in a third of the steps.
    """

    sizes: tuple[float, ...]
    samples: int
    sample_time: float
    noise: float = 0.0
    runs: int = 1
    variants: int = 0
    load: float = 0.0
    power: int = 1
    stronger: float = 1.0
    quiet: bool = True

    def episodes(self) -> tuple[Episode, ...]:
        """All episodes, run by run; their weights sum to 1 for steps as large as the first."""
        count = self.runs if self.noise > 0.0 or self.variants else 1
        return tuple(
            self._one(size, number, run, count)
            for run in range(count)
            for number, size in enumerate(self.sizes)
        )

    def _one(self, size: float, number: int, run: int, count: int) -> Episode:
        nominal, gain = size, 1.0
        if run:
            size *= 1.0 - SHORTER * ((run / count + STRIDE * number) % 1.0)
            gain = self.stronger if (run - number) % EVERY == 0 else 1.0
        weight = abs(self.sizes[0] / size) ** self.power / (count * len(self.sizes))
        bare = step(size, self.samples, self.sample_time, weight)
        noise = np.zeros(self.samples)
        if run or not self.quiet:
            noise = self.noise * np.random.default_rng([SEED, run, number]).standard_normal(self.samples)
        load = np.full(self.samples, self.load)
        rest = self.samples - max(round(REST * self.samples), 2)
        variant = (run + number) % (self.variants + 1) if run else 0
        return replace(
            bare, noise=noise, load=load, variant=variant, rest=rest, gain=gain, nominal=nominal, run=run
        )


def sizes_for(
    wanted: Sequence[float], reached: Callable[[float], bool] = lambda size: True
) -> tuple[float, ...]:
    """The requested steps, then reachable shares of the largest in both directions; each once."""
    largest = max(wanted, key=abs)
    every = [*wanted, *(share * largest for share in SHARES if reached(share * largest))]
    return tuple(
        s for i, s in enumerate(every) if not any(math.isclose(s, t, rel_tol=1e-9) for t in every[:i])
    )


def hunting_limit(largest: float, noise: float) -> float:
    """Peak to peak at rest beyond which a loop hunts, output's unit."""
    return max(HUNTING_OVER_NOISE * noise, HUNTING_SHARE * abs(largest))
