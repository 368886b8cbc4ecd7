"""The discrete PID controller as Python code uses it.

    controller = Controller(Gains(kp=60.0, ki=80.0, kd=1.5, derivative_filter=5e-3), Settings(1e-3, low=-5.0, high=5.0))
    controller.reset(reference, measured, command)    # bumpless start: the first step gives `command` again
    command = controller.step(reference, measured)    # once a sample: 0.6 microseconds
    controller.change(new_gains)                      # bumpless: the command at the last sample stays what it was
    kept = controller.state; controller.restore(kept) # memory as an array of float64, shape (MEMORY,)

Reference and measurement in the model's output unit (m), command in its input unit (V). A NaN stands for a missing
sample: the last one is used again; the caller decides how long this may last. Inside other compiled code call
`optid.pid.pid_step.law(settings, memory, reference, measured)` with `controller.vector` and a copy of
`controller.state`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np

from optid.errors import InputError
from optid.pid import pid_step
from optid.pid.pid_step import Array

NO_NOTCH = (1.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Gains:
    """The tuned gains; u = kp (b r - y) + integral of ki (r - y) + kd d(c r - y)/dt.

    Attributes:
        kp: command per output, V/m.
        ki: of the integral in continuous time, V/(m s).
        kd: of the derivative, V s/m.
        derivative_filter: time constant Tf of the derivative's first-order lag, s; 0 for none.
        setpoint_weight: b, share of the reference in the proportional part.
        derivative_weight: c, share of the reference in the derivative; 0 puts it on the measurement alone.
    """

    kp: float
    ki: float = 0.0
    kd: float = 0.0
    derivative_filter: float = 0.0
    setpoint_weight: float = 1.0
    derivative_weight: float = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not math.isfinite(value):
                raise InputError(f"{value}", field=name, expected="a finite number")
        if self.derivative_filter < 0:
            raise InputError(
                f"{self.derivative_filter}",
                field="derivative_filter",
                expected="a time constant, s, not negative",
            )

    @property
    def vector(self) -> Array:
        """In the order of `optid.pid.pid_step`, shape (GAINS,)."""
        return np.array(
            [
                self.kp,
                self.ki,
                self.kd,
                self.derivative_filter,
                self.setpoint_weight,
                self.derivative_weight,
            ]
        )


class AntiWindup(Enum):
    """Behaviour of the integral while the command is at a limit."""

    NONE = "the integral keeps integrating"
    CLAMPING = "the integral stops while it would push further into the limit"
    BACK_CALCULATION = "the integral gives back what the limit took away, over the tracking time"


@dataclass(frozen=True)
class Notch:
    """A filter of the command that takes out one frequency.

    Attributes:
        frequency: rad/s, below half the sampling frequency.
        width: rad/s.
        depth: gain at the frequency, 0 to 1; 1 for none.
    """

    frequency: float
    width: float
    depth: float = 0.0

    def __post_init__(self) -> None:
        for name in ("frequency", "width"):
            value = getattr(self, name)
            if not 0.0 < value < math.inf:
                raise InputError(f"{value:g}", where="notch", field=name, expected="rad/s, more than 0")
        if not 0.0 <= self.depth <= 1.0:
            raise InputError(f"{self.depth:g}", where="notch", field="depth", expected="0 to 1")

    def coefficients(self, sample_time: float) -> Array:
        """b0, b1, b2, a1, a2 of (b0 + b1/z + b2/z2) / (1 + a1/z + a2/z2): bilinear, exact at its frequency.

        Raises:
            InputError: the frequency is beyond half the sampling frequency.
        """
        if not self.frequency * sample_time < math.pi:
            raise InputError(
                f"{self.frequency:g} rad/s",
                where="notch",
                field="frequency",
                expected=f"less than {math.pi / sample_time:g} rad/s, half the sampling frequency",
            )
        K = math.tan(0.5 * self.frequency * sample_time)
        share = K * self.width / self.frequency
        whole, middle = 1.0 + share + K * K, 2.0 * (K * K - 1.0)
        ends = 1.0 + self.depth * share + K * K, middle, 1.0 - self.depth * share + K * K
        return np.array([*ends, middle, 1.0 - share + K * K]) / whole


@dataclass(frozen=True)
class Settings:
    """The settings of a controller apart from its gains, in the command's unit.

    Attributes:
        sample_time: s.
        low, high: limits of the command; infinite for none.
        rate: largest change per second; infinite for none.
        deadband_low, deadband_high: edges of the valve's dead band, at most 0 and at least 0; commands jump over it.
        deadband_onset: size of the command over which the jump is blended in.
        resolution: step of the output converter, counted from 0; 0 for none.
        anti_windup: see there.
        tracking_time: of back-calculation, s.
        acceleration: feed-forward, command per acceleration of the set-point (filtered as the derivative is).
        friction: command that overcomes dry friction, added in the direction of the set-point's motion.
        friction_speed: speed of the set-point over which it changes sign, output's unit/s.
        notch: of the command; None for none.
    """

    sample_time: float
    low: float = -math.inf
    high: float = math.inf
    rate: float = math.inf
    deadband_low: float = 0.0
    deadband_high: float = 0.0
    deadband_onset: float = 0.0
    resolution: float = 0.0
    anti_windup: AntiWindup = AntiWindup.CLAMPING
    tracking_time: float = 0.0
    acceleration: float = 0.0
    friction: float = 0.0
    friction_speed: float = 0.0
    notch: Notch | None = None

    def __post_init__(self) -> None:
        if not (0 < self.sample_time < math.inf):
            raise InputError(f"{self.sample_time}", field="sample_time", expected="seconds, more than 0")
        if not self.low < self.high:
            raise InputError(
                f"low {self.low:g} is not below high {self.high:g}", field="limits", expected="low < high"
            )
        if not self.rate > 0:
            raise InputError(f"{self.rate:g}", field="rate", expected="more than 0 per second")
        self._check_valve()
        self._check_ahead()
        if self.anti_windup is AntiWindup.BACK_CALCULATION and not self.tracking_time >= self.sample_time:
            raise InputError(
                f"{self.tracking_time:g}",
                field="tracking_time",
                expected=f"at least one sample, {self.sample_time:g} s",
            )

    def _check_ahead(self) -> None:
        for name in ("acceleration", "friction"):
            if not math.isfinite(getattr(self, name)):
                raise InputError(f"{getattr(self, name)}", field=name, expected="a finite number")
        if self.friction and not 0.0 < self.friction_speed < math.inf:
            raise InputError(
                f"{self.friction_speed:g}",
                field="friction_speed",
                expected="a speed greater than 0",
                hint="without it the sign of a resting set-point's noise would switch the compensation",
            )
        if self.notch is not None:
            self.notch.coefficients(self.sample_time)

    def _check_valve(self) -> None:
        if not (-math.inf < self.deadband_low <= 0.0 <= self.deadband_high < math.inf):
            raise InputError(
                f"{self.deadband_low:g} to {self.deadband_high:g}",
                field="deadband",
                expected="low <= 0 <= high",
            )
        widest = max(-self.deadband_low, self.deadband_high)
        if widest > 0 and not 0 < self.deadband_onset < math.inf:
            raise InputError(
                f"{self.deadband_onset:g}",
                field="deadband_onset",
                expected="a command greater than 0",
                hint="a jump at zero command would make the axis chatter",
            )
        if widest > 0 and not (self.low <= self.deadband_low and self.deadband_high <= self.high):
            raise InputError("the dead band is wider than the limits", field="deadband")
        if not 0 <= self.resolution < math.inf:
            raise InputError(
                f"{self.resolution:g}", field="resolution", expected="a step of the command or 0"
            )
        if not self.resolution <= self.high - self.low:
            raise InputError(
                f"{self.resolution:g} is larger than the range between the limits", field="resolution"
            )
        if self.resolution > 0 and self.rate * self.sample_time < self.resolution * (1 - pid_step.SLACK):
            raise InputError(
                f"{self.rate:g} per second is less than one step of {self.resolution:g} a sample: "
                "the command could never move",
                field="rate",
                expected=f"at least {self.resolution / self.sample_time:g} per second",
            )

    @property
    def vector(self) -> Array:
        """The settings of `optid.pid.pid_step` after the gains, shape (SETTINGS - GAINS,)."""
        back = self.anti_windup is AntiWindup.BACK_CALCULATION
        return np.array(
            [
                self.sample_time,
                self.low,
                self.high,
                self.rate * self.sample_time,
                self.deadband_low,
                self.deadband_high,
                1.0 / self.deadband_onset if self.deadband_onset > 0 else 0.0,
                self.resolution,
                1.0 / self.resolution if self.resolution > 0 else 0.0,
                float(self.anti_windup is AntiWindup.CLAMPING),
                self.sample_time / self.tracking_time if back else 0.0,
                self.acceleration,
                self.friction,
                1.0 / self.friction_speed if self.friction else 0.0,
                *(NO_NOTCH if self.notch is None else self.notch.coefficients(self.sample_time)),
            ]
        )


class Controller:
    """A running controller; one object per loop, not shared between threads."""

    def __init__(self, gains: Gains, settings: Settings) -> None:
        self.gains, self.settings = gains, settings
        self.vector = np.concatenate([gains.vector, settings.vector])
        self._memory = np.zeros(pid_step.MEMORY)
        self._memory[pid_step.LAST_COMMAND] = min(max(0.0, settings.low), settings.high)

    def step(self, reference: float, measured: float) -> float:
        """The command for this sample; the limits hold for it, and the rate from the last one to it."""
        return pid_step.step(self.vector, self._memory, reference, measured)

    def reset(self, reference: float, measured: float, command: float = 0.0) -> None:
        """Start, or restart, from a present command: the first step returns it again if nothing moves.

        Without integral action (ki = 0) nothing holds the command: the first step may jump, as far as the rate limit
        allows.

        Raises:
            InputError: a value that is not finite.
        """
        for name, value in (("reference", reference), ("measured", measured), ("command", command)):
            if not math.isfinite(value):
                raise InputError(f"{value}", field=name, expected="a finite number")
        pid_step.begin(self.vector, self._memory, reference, measured, command)

    def change(self, gains: Gains) -> None:
        """Take new gains, such that the command of the last sample would have been the same.

        With ki = 0 the integral part is dropped instead, and the command may jump.
        """
        new = self.vector.copy()
        new[: pid_step.GAINS] = gains.vector
        pid_step.switch(self.vector, self._memory, new)
        self.gains, self.vector[:] = gains, new

    @property
    def command(self) -> float:
        """The last one."""
        return float(self._memory[pid_step.LAST_COMMAND])

    @property
    def state(self) -> Array:
        """A copy of the memory, shape (MEMORY,): what `restore` takes."""
        return self._memory.copy()

    def restore(self, state: Array) -> None:
        """Continue from a memory that `state` returned.

        Raises:
            InputError: of another shape or not finite.
        """
        state = np.asarray(state, dtype=np.float64)
        if state.shape != (pid_step.MEMORY,) or not np.all(np.isfinite(state)):
            raise InputError(
                f"shape {state.shape}", field="state", expected=f"{pid_step.MEMORY} finite numbers"
            )
        self._memory[:] = state
