"""The least axis that sticks: an identified model with an integrator as force, speed and position, and dry friction.

A linear model knows no dry friction, and what is best for it, integral action above all, makes a real axis hunt. The
model's integrator and its slowest two other poles give position from speed from force:

    dF/dt = k u - w^2 v,    dv/dt = F - c v - f sgn v,    dx/dt = v    (per unit of mass)

where s (s^2 + 2 z w s + w^2) are those poles and k / w^2 is the speed gain. In the recording dry friction passed for a
part of the damping 2 z w. How much is not known from the model alone: a share of it is taken, at the speed to which
half of the command's range drives the axis, and other shares in the runs that have noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from optid.core.model import Array
from optid.pid.controller import Settings
from optid.pid.law import GAINS, LAST_COMMAND, MEMORY, law
from optid.tuning.bench import Bench
from optid.tuning.demand import Episode
from optid.tuning.loop import ESCAPED, passed
from optid.tuning.machine import compiled
from optid.tuning.plant import MARGIN, Plant

SHARE = 0.5  # of the damping that is dry friction: neither all nor nothing is known to be wrong
OTHERS = (0.25, 0.75)  # shares of the variants
FINE = 0.05  # steps of the integration times the fastest rate
MOST = 64  # steps in a sample


@dataclass(frozen=True)
class Mechanics:
    """Of the axis, per unit of mass.

    Attributes:
        speed_gain: steady speed per command.
        frequency: w, rad/s.
        damping: 2 z w, 1/s, dry friction's share included.
        delay: samples by which a command comes late beyond the first.
    """

    speed_gain: float
    frequency: float
    damping: float
    delay: int

    def friction(self, share: float, command: float) -> tuple[float, float]:
        """Viscous rate (1/s) and dry friction (output's unit/s2) if a share of the damping is dry at half a command."""
        speed = 0.5 * command * abs(self.speed_gain)
        return (1.0 - share) * self.damping, share * self.damping * speed * math.pi / 4.0


def mechanics(plant: Plant) -> Mechanics | None:
    """Of a plant with one exact integrator and two stable poles behind it at least; None for any other."""
    others = [p for p in plant.poles if abs(p - 1.0) > MARGIN]
    slow = sorted((p for p in others if abs(p) > MARGIN), key=lambda p: -abs(p))
    if len(others) != plant.a.size - 1 or any(abs(p) >= 1.0 for p in others) or len(slow) < 2:
        return None
    pair = [slow[0], slow[1]] if slow[0].imag == 0.0 else [slow[0], slow[0].conjugate()]
    if any(p.imag == 0.0 and p.real <= 0.0 for p in pair):
        return None
    s = np.log(np.array(pair, dtype=complex)) / plant.sample_time
    rest = np.real(np.poly(others))
    gain = float(plant.b.sum()) / (float(rest.sum()) * plant.sample_time)
    return Mechanics(gain, math.sqrt(float(np.real(s[0] * s[1]))), -float(np.real(s.sum())), plant.delay - 1)


class StickingAxis(Bench):
    """Runs gains on that axis.

    Args:
        axis: its mechanics.
        episodes: to run; those of variant k > 0 have the k-th of the other shares of dry friction.
        command: half the range of the command, its unit.
        dead_zone: of the valve, (low, high).
    """

    def __init__(
        self,
        axis: Mechanics,
        episodes: tuple[Episode, ...],
        command: float,
        dead_zone: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        super().__init__(episodes)
        self.axis, self._dead = axis, np.array(dead_zone)
        self._friction = [axis.friction(share, command) for share in (SHARE, *OTHERS)]

    def _run(self, vector: Array, settings: Settings, episode: Episode) -> tuple[Array, Array]:
        n, axis = episode.reference.size, self.axis
        y, u = np.empty(n), np.empty(n)
        viscous, dry = self._friction[min(episode.variant, len(self._friction) - 1)]
        T = settings.sample_time
        steps = min(max(math.ceil(T * max(axis.frequency, viscous) / FINE), 1), MOST)
        physics = np.array([axis.speed_gain * axis.frequency**2, axis.frequency**2, viscous, dry, T / steps])
        one = episode.reference, episode.load, episode.noise
        _stuck_and_slid(vector, physics, self._dead, steps, axis.delay, one, y, u)
        return y, u


@compiled
def _stuck_and_slid(
    s: Any, physics: Any, dead: Any, steps: Any, delay: Any, episode: Any, y: Any, u: Any
) -> None:
    """One episode; friction is implicit, so that a speed within its reach is exactly 0."""
    reference, load, noise = episode
    k, stiffness, viscous, dry, h = physics
    m = np.zeros(MEMORY)
    m[LAST_COMMAND] = min(max(0.0, s[GAINS + 1]), s[GAINS + 2])
    bound = ESCAPED * (np.max(np.abs(reference)) + np.max(np.abs(load)))
    x, v, force = 0.0, 0.0, 0.0
    for n in range(reference.size):
        y[n] = x
        u[n] = law(s, m, reference[n], x + noise[n])
        if not abs(x) <= bound:
            y[n:] = np.nan
            u[n:] = np.nan
            return
        late = n - delay
        drive = k * passed((u[late] if late >= 0 else 0.0) + load[n], dead)
        for _ in range(steps):
            force += h * (drive - stiffness * v)
            free = (v + h * force) / (1.0 + h * viscous)
            reach = h * dry / (1.0 + h * viscous)
            v = 0.0 if abs(free) <= reach else free - math.copysign(reach, free)
            x += h * v
