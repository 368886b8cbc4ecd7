"""The minimal axis with stiction: force, speed and position with dry friction, from a model or its recording.

A linear model has no dry friction, and gains optimal for it, above all integral action, make a real axis hunt. The
minimal axis with friction is

    dF/dt = k (u + alpha |u|) - w^2 v,    dv/dt = F - c v - f(v) sgn v,    dx/dt = v    (per unit of mass)

with k / w^2 the speed gain. `optid identify` fits it to the recording (`optid.armax.sliding`). If a model file has no
such fit, s (s^2 + 2 z w s + w^2) are an integrator and the slowest two other poles of the model, and dry friction in
the recording appears as a part of the damping 2 z w: a share of it is assumed, at the speed that half of the command's
range gives, and other shares in the runs with noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from optid.armax.sliding import SlidingAxis
from optid.core.model import Array
from optid.pid.controller import Settings
from optid.pid.pid_step import GAINS, LAST_COMMAND, MEMORY, law
from optid.tuning.bench import Bench
from optid.tuning.loop import ESCAPED, passed
from optid.tuning.machine import compiled
from optid.tuning.plant import MARGIN, Plant
from optid.tuning.scenarios import Episode

SHARE = 0.5  # share of the damping assumed as dry friction without a fit: all and nothing are both known to be wrong
OTHERS = (0.25, 0.75)  # shares of the variants
# Of a fitted axis: viscous and dry friction, nominal and in the variants, over the fitted ones. A regression
# attributes some of one to the other: on the five rigs of studies/pid_gains.py the true ones were 0.63 to 0.79 and
# 1.3 to 1.8 of what it found.
FITTED = ((0.7, 1.5), (0.8, 1.3), (0.63, 1.8))
# Of the asymmetry of speed, in the same sets. If all of it is in the valve, noise at rest causes a drift that friction
# cannot hold; none, if pressures cause it in motion only: a recording of motion cannot decide.
ASYMMETRIES = (0.5, 0.0, 1.0)
# Share of the speed at half the command's range, over which break-away decays to friction in motion.
CREEP = 0.01
FINE = 0.05  # steps of the integration times the fastest rate
MOST = 64  # steps in a sample


@dataclass(frozen=True)
class Mechanics:
    """Of the axis, per unit of mass.

    Attributes:
        speed_gain: steady speed per command.
        frequency: w, rad/s.
        frictions: viscous rate (1/s) and dry friction (output's unit/s2) of the nominal axis and its variants.
        delay: delay of a command in samples, beyond the first.
        breakaway: friction at rest over that in motion.
        creep: speed over which break-away decays to sliding friction.
        asymmetries: alpha of the nominal axis and its variants, by which it responds more to positive commands.
    """

    speed_gain: float
    frequency: float
    frictions: tuple[tuple[float, float], ...]
    delay: int = 0
    breakaway: float = 1.0
    creep: float = 1.0
    asymmetries: tuple[float, ...] = (0.0,)


def fitted_mechanics(axis: SlidingAxis, command: float) -> Mechanics:
    """Of the axis that was fitted to the recording; `command` is half the range of the command."""
    frictions = tuple((v * axis.damping, d * axis.dry_friction) for v, d in FITTED)
    creep = CREEP * command * abs(axis.speed_gain)
    asymmetries = tuple(share * axis.asymmetry for share in ASYMMETRIES)
    return Mechanics(axis.speed_gain, axis.frequency, frictions, 0, axis.breakaway_ratio, creep, asymmetries)


def assumed_mechanics(plant: Plant, command: float) -> Mechanics | None:
    """Mechanics of a plant with one exact integrator and at least two stable poles; None for any other."""
    others = [complex(p) for p in plant.poles if abs(p - 1.0) > MARGIN]
    slow = sorted((p for p in others if abs(p) > MARGIN), key=lambda p: abs(np.log(p)))
    if len(others) != plant.a.size - 1 or any(abs(p) >= 1.0 for p in others) or len(slow) < 2:
        return None
    pair = [slow[0], slow[1]] if slow[0].imag == 0.0 else [slow[0], slow[0].conjugate()]
    if any(p.imag == 0.0 and p.real <= 0.0 for p in pair):
        return None
    s = np.log(np.array(pair, dtype=complex)) / plant.sample_time
    rest = np.real(np.poly(others))
    gain = float(plant.b.sum()) / (float(rest.sum()) * plant.sample_time)
    square, damping = float(np.real(s[0] * s[1])), -float(np.real(s.sum()))
    speed = 0.5 * command * abs(gain)
    frictions = tuple(
        ((1.0 - share) * damping, share * damping * speed * math.pi / 4.0) for share in (SHARE, *OTHERS)
    )
    return Mechanics(gain, math.sqrt(square), frictions, plant.delay - 1, creep=speed)


class StickingAxis(Bench):
    """Runs gains on that axis.

    Args:
        axis: its mechanics.
        episodes: to run; those of variant k have the k-th friction.
        dead_zone: of the valve, (low, high).
    """

    def __init__(
        self, axis: Mechanics, episodes: tuple[Episode, ...], dead_zone: tuple[float, float] = (0.0, 0.0)
    ) -> None:
        super().__init__(episodes)
        self.axis, self._dead = axis, np.array(dead_zone)

    def _run(self, vector: Array, settings: Settings, episode: Episode) -> tuple[Array, Array]:
        n, axis = episode.reference.size, self.axis
        y, u = np.empty(n), np.empty(n)
        viscous, dry = axis.frictions[min(episode.variant, len(axis.frictions) - 1)]
        T = settings.sample_time
        steps = min(max(math.ceil(T * max(axis.frequency, viscous) / FINE), 1), MOST)
        gain = episode.gain * axis.speed_gain * axis.frequency**2
        excess = (axis.breakaway - 1.0) * dry
        alpha = axis.asymmetries[min(episode.variant, len(axis.asymmetries) - 1)]
        physics = np.array([gain, alpha, axis.frequency**2, viscous, dry, T / steps, excess, axis.creep])
        one = episode.reference, episode.load, episode.noise
        _stuck_and_slid(vector, physics, self._dead, steps, axis.delay, one, y, u)
        return y, u


@compiled
def _stuck_and_slid(
    s: Any, physics: Any, dead: Any, steps: Any, delay: Any, episode: Any, y: Any, u: Any
) -> None:
    """One episode; friction is implicit, so that a speed within its reach is exactly 0."""
    reference, load, noise = episode
    k, alpha, stiffness, viscous, dry, h, excess, creep = physics
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
        open_by = passed((u[late] if late >= 0 else 0.0) + load[n], dead)
        drive = k * (open_by + alpha * abs(open_by))
        for _ in range(steps):
            force += h * (drive - stiffness * v)
            free = (v + h * force) / (1.0 + h * viscous)
            level = dry + (excess * math.exp(-abs(v) / creep) if excess > 0.0 else 0.0)
            reach = h * level / (1.0 + h * viscous)
            v = 0.0 if abs(free) <= reach else free - math.copysign(reach, free)
            x += h * v
