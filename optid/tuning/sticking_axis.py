"""The minimal axis with stiction: force, speed and position with dry friction, from a model or its recording.

A linear model has no dry friction, and gains optimal for it, above all integral action, make a real axis hunt. The
minimal axis with friction is

    dF/dt = k (u + alpha |u|) - w^2 v - l |u| F,    dv/dt = F - c v - f(v) sgn v,    dx/dt = v    (per unit of mass)

with k / w^2 the speed gain. `optid identify` fits it to the recording (`optid.armax.sliding`). If a model file has no
such fit, s (s^2 + 2 z w s + w^2) are an integrator and the slowest two other poles of the model, and dry friction in
the recording appears as a part of the damping 2 z w: a share of it is assumed, at the speed that half of the command's
range gives, and other shares in the runs with noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

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

# Shares of the damping assumed as dry friction without a fit: all and nothing are both known to be wrong.
SHARES = (0.5, 0.25, 0.75)


class CorrectionFactors(NamedTuple):
    """True values over those of a fit: viscous and dry friction, what is added to it at rest, gain, decay; share of the
    asymmetry in the valve.
    """

    viscous: float
    dry: float
    at_rest: float
    gain: float
    decay: float
    asymmetry: float


# A regression attributes some of one to the other: on the rigs of studies/pid_gains.py the true values were 0.85 to
# 1.09, 1.1 to 1.46, 1.1 to 1.25 and 0.8 to 1.7 times what it found. If all of the asymmetry is in the valve, noise at
# rest causes a drift that friction cannot hold; none, if pressures cause it in motion only: a recording of motion
# cannot decide.
CORRECTIONS = (
    CorrectionFactors(0.95, 1.25, 1.0, 1.15, 1.0, 0.5),
    CorrectionFactors(1.05, 1.1, 1.0, 1.1, 0.7, 0.0),
    CorrectionFactors(0.85, 1.45, 1.5, 1.2, 0.7, 1.0),
    CorrectionFactors(1.05, 1.1, 1.0, 1.25, 1.4, 1.0),
    CorrectionFactors(0.85, 1.45, 1.5, 1.1, 1.4, 0.0),
)
# Share of the speed at half the command's range, over which break-away decays to friction in motion.
CREEP = 0.01
LEAST = 0.2  # of gain and stiffness, over those in the middle of the stroke
FINE = 0.05  # steps of the integration times the fastest rate
MOST = 64  # steps in a sample


@dataclass(frozen=True)
class Mechanics:
    """Of the axis, per unit of mass.

    Attributes:
        gain: k, force's rate per command.
        frequency: w, rad/s.
        viscous: c, 1/s.
        dry: f, output's unit/s2.
        delay: delay of a command in samples, beyond the first.
        breakaway: friction at rest over that in motion.
        creep: speed over which break-away decays to sliding friction.
        asymmetry: alpha, by which it responds more to positive commands.
        decay: l, rate at which the force decays per command.
        position_dependence: of k, then of w^2: share by which it grows per output's unit and per its square; and how
            far from the start this is known: it is constant beyond.
    """

    gain: float
    frequency: float
    viscous: float
    dry: float
    delay: int = 0
    breakaway: float = 1.0
    creep: float = 1.0
    asymmetry: float = 0.0
    decay: float = 0.0
    position_dependence: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)


def fitted_mechanics(axis: SlidingAxis, command: float) -> tuple[Mechanics, ...]:
    """Of the axis that was fitted to the recording, and variants; `command` is half the range of the command."""
    return tuple(
        Mechanics(
            true.gain * axis.speed_gain * axis.frequency**2,
            axis.frequency,
            true.viscous * axis.damping,
            true.dry * axis.dry_friction,
            breakaway=1.0 + true.at_rest * (axis.breakaway_ratio - 1.0),
            creep=CREEP * command * abs(axis.speed_gain),
            asymmetry=true.asymmetry * axis.asymmetry,
            decay=true.decay * axis.decay,
            position_dependence=axis.position_dependence,
        )
        for true in CORRECTIONS
    )


def assumed_mechanics(plant: Plant, command: float) -> tuple[Mechanics, ...]:
    """Of a plant with one exact integrator and at least two stable poles, and variants; none for any other."""
    others = [complex(p) for p in plant.poles if abs(p - 1.0) > MARGIN]
    slow = sorted((p for p in others if abs(p) > MARGIN), key=lambda p: abs(np.log(p)))
    if len(others) != plant.a.size - 1 or any(abs(p) >= 1.0 for p in others) or len(slow) < 2:
        return ()
    pair = [slow[0], slow[1]] if slow[0].imag == 0.0 else [slow[0], slow[0].conjugate()]
    if any(p.imag == 0.0 and p.real <= 0.0 for p in pair):
        return ()
    s = np.log(np.array(pair, dtype=complex)) / plant.sample_time
    speed_gain = float(plant.b.sum()) / (float(np.real(np.poly(others)).sum()) * plant.sample_time)
    square, damping = float(np.real(s[0] * s[1])), -float(np.real(s.sum()))
    speed = 0.5 * command * abs(speed_gain)
    dry = damping * speed * math.pi / 4.0
    first = Mechanics(speed_gain * square, math.sqrt(square), damping, dry, plant.delay - 1, creep=speed)
    return tuple(replace(first, viscous=(1.0 - share) * damping, dry=share * dry) for share in SHARES)


class StickingAxis(Bench):
    """Runs gains on that axis.

    Args:
        axes: its mechanics and variants.
        episodes: to run, each on the axis of its variant.
        dead_zone: of the valve, (low, high).
    """

    def __init__(
        self,
        axes: Sequence[Mechanics],
        episodes: tuple[Episode, ...],
        dead_zone: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        super().__init__(episodes)
        self.axes, self._dead = tuple(axes), np.array(dead_zone)

    def _run(self, vector: Array, settings: Settings, episode: Episode) -> tuple[Array, Array]:
        n, axis, T = episode.reference.size, self.axes[episode.variant], settings.sample_time
        y, u = np.empty(n), np.empty(n)
        steps = min(max(math.ceil(T * max(axis.frequency, axis.viscous) / FINE), 1), MOST)
        force = episode.gain * axis.gain, axis.asymmetry, axis.frequency**2, axis.decay
        friction = axis.viscous, axis.dry, (axis.breakaway - 1.0) * axis.dry, axis.creep
        physics = np.array([*force, *friction, T / steps, *axis.position_dependence])
        one = episode.reference, episode.load, episode.noise
        _stuck_and_slid(vector, physics, self._dead, steps, axis.delay, one, y, u)
        return y, u


@compiled
def _stuck_and_slid(
    s: Any, physics: Any, dead: Any, steps: Any, delay: Any, episode: Any, y: Any, u: Any
) -> None:
    """One episode; friction is implicit, so that a speed within its reach is exactly 0."""
    reference, load, noise = episode
    k, alpha, stiffness, decay, viscous, dry, excess, creep, h = physics[:9]
    gain_1, gain_2, stiff_1, stiff_2, known = physics[9:]
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
        at = min(max(x, -known), known)
        drive = k * max(1.0 + at * (gain_1 + at * gain_2), LEAST) * (open_by + alpha * abs(open_by))
        spring = stiffness * max(1.0 + at * (stiff_1 + at * stiff_2), LEAST)
        kept = 1.0 / (1.0 + h * decay * abs(open_by))
        for _ in range(steps):
            force = (force + h * (drive - spring * v)) * kept
            free = (v + h * force) / (1.0 + h * viscous)
            level = dry + (excess * math.exp(-abs(v) / creep) if excess > 0.0 else 0.0)
            reach = h * level / (1.0 + h * viscous)
            v = 0.0 if abs(free) <= reach else free - math.copysign(reach, free)
            x += h * v
