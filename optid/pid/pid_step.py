"""One sample of the discrete PID controller: the single definition from which all others are derived.

`law` is straight-line code over two arrays, settings `s` and memory `m`; so are `start` and `change`. The same text
is compiled by numba (the live loop and every simulation), run with CasADi operands (`optid.pid.symbolic`: gradients),
and rewritten as C and as IEC 61131-3 structured text (`optid.core.translate`). Conditions are therefore written with
the helpers below, never with `if`, and nothing is divided by a setting that may be zero.

Two degrees of freedom (Åström and Hägglund, Advanced PID Control, 2006, ch. 3), backward differences:

    u = kp (b r - y) + integral of ki (r - y) + kd d(c r - y)/dt, the derivative lagged by the time constant Tf

then a notch (Franklin, Powell and Workman, Digital Control of Dynamic Systems, 1998, ch. 8), acceleration feed-forward
and friction compensation, which depend on the noise-free set-point, then dead-band compensation, limits, rate limit,
resolution; anti-windup corrects the integral by what the limits cut off.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numba
import numpy as np
from numpy.typing import NDArray

from optid.core.jit_cache import kept

Array = NDArray[np.float64]

# Settings. The first GAINS of them are tuned.
KP, KI, KD, DERIVATIVE_FILTER, SETPOINT_WEIGHT, DERIVATIVE_WEIGHT = range(6)
GAINS = 6
SAMPLE_TIME = 6  # s
LOW, HIGH = 7, 8  # command's unit; infinite for none
MAX_MOVE = 9  # largest change of the command in one sample
DEADBAND_LOW, DEADBAND_HIGH = 10, 11  # edges of the dead band to jump over; not positive, not negative
ONSET = 12  # 1 / (command over which the jump is blended in)
RESOLUTION, PER_STEP = 13, 14  # smallest step of the command and its inverse; both 0 for none
CLAMPING = 15  # 1: the integral stops while it would push further into a limit
TRACKING = 16  # share of the excess that the integral gives back each sample
ACCELERATION = 17  # command per acceleration of the set-point
# Command that overcomes dry friction, and 1 / (speed over which it changes sign).
FRICTION, PER_SPEED = 18, 19
NOTCH_B0, NOTCH_B1, NOTCH_B2, NOTCH_A1, NOTCH_A2 = range(20, 25)  # (b0 + b1/z + b2/z2) / (1 + a1/z + a2/z2)
SETTINGS = 25

# Memory.
INTEGRAL = 0  # integral part, in the command's unit, so that a change of gains leaves it alone
SLOPE = 1  # filtered derivative of c r - y, per second
LAST_COMMAND, LAST_SETPOINT, LAST_MEASURED = 2, 3, 4
SPEED = 5  # of the set-point, filtered, per second
NOTCH_1, NOTCH_2 = 6, 7  # of the notch, transposed direct form II
MEMORY = 8

SLACK = 1e-9  # of a resolution step: a limit on a step may miss it by rounding

Kernel = TypeVar("Kernel", bound=Callable[..., object])
# No fused multiply-add: the exported C and structured text give the same bits.
compiled: Callable[[Kernel], Kernel] = kept(error_model="numpy", nogil=True, _nrt=False)
folded: Callable[[Kernel], Kernel] = numba.njit(error_model="numpy", nogil=True, _nrt=False, inline="always")


@folded
def chosen(condition: bool, this: float, other: float) -> float:
    """`this` where the condition holds; both are computed."""
    return this if condition else other


@folded
def bounded(value: float, low: float, high: float) -> float:
    """The value moved into low..high."""
    return min(max(value, low), high)


@folded
def smaller(one: float, other: float) -> float:
    """The smaller one."""
    return min(one, other)


@folded
def larger(one: float, other: float) -> float:
    """The larger one."""
    return max(one, other)


@folded
def known(value: float, otherwise: float) -> float:
    """The value, or `otherwise` where it is not a number."""
    return value if value == value else otherwise


@folded
def whole(value: float) -> float:
    """The largest whole number not above the value."""
    return float(np.floor(value))


@folded
def law(s: Array, m: Array, setpoint: float, measured: float) -> float:
    """One sample: the command, by settings s, from memory m, which is brought up to date."""
    # A missing sample: the last one is used.
    target = known(setpoint, m[LAST_SETPOINT])
    seen = known(measured, m[LAST_MEASURED])
    error = target - seen
    # Filtered derivative and integral by backward differences.
    rise = s[DERIVATIVE_WEIGHT] * (target - m[LAST_SETPOINT]) - (seen - m[LAST_MEASURED])
    slope = (s[DERIVATIVE_FILTER] * m[SLOPE] + rise) / (s[DERIVATIVE_FILTER] + s[SAMPLE_TIME])
    growth = s[KI] * s[SAMPLE_TIME] * error
    wish = s[KP] * (s[SETPOINT_WEIGHT] * target - seen) + (m[INTEGRAL] + growth) + s[KD] * slope
    # Notch.
    passed = s[NOTCH_B0] * wish + m[NOTCH_1]
    m[NOTCH_1] = s[NOTCH_B1] * wish - s[NOTCH_A1] * passed + m[NOTCH_2]
    m[NOTCH_2] = s[NOTCH_B2] * wish - s[NOTCH_A2] * passed
    # Acceleration feed-forward and friction compensation, by the set-point.
    speed = (s[DERIVATIVE_FILTER] * m[SPEED] + (target - m[LAST_SETPOINT])) / (
        s[DERIVATIVE_FILTER] + s[SAMPLE_TIME]
    )
    ahead = s[ACCELERATION] * ((speed - m[SPEED]) / s[SAMPLE_TIME])
    drive = passed + ahead + s[FRICTION] * bounded(speed * s[PER_SPEED], -1.0, 1.0)
    # Dead-band compensation: a jump to the edge of the dead band, spread over a small command.
    edge = chosen(drive > 0.0, s[DEADBAND_HIGH], s[DEADBAND_LOW])
    asked = drive + edge * smaller(abs(drive) * s[ONSET], 1.0)
    # Limits and rate limit.
    most = smaller(s[HIGH], m[LAST_COMMAND] + s[MAX_MOVE])
    least = larger(s[LOW], m[LAST_COMMAND] - s[MAX_MOVE])
    limited = bounded(asked, least, most)
    # Anti-windup: clamping and back-calculation.
    excess = asked - limited
    resting = chosen(excess * growth > 0.0, s[CLAMPING], 0.0)
    m[INTEGRAL] = m[INTEGRAL] + (1.0 - resting) * growth - s[TRACKING] * excess
    # Resolution: the nearest step that the limits allow.
    highest = whole(most * s[PER_STEP] + SLACK)
    lowest = -whole(SLACK - least * s[PER_STEP])
    steps = bounded(whole(limited * s[PER_STEP] + 0.5), lowest, highest)
    command = chosen(s[RESOLUTION] > 0.0, bounded(s[RESOLUTION] * steps, s[LOW], s[HIGH]), limited)
    m[SLOPE] = slope
    m[SPEED] = speed
    m[LAST_COMMAND] = command
    m[LAST_SETPOINT] = target
    m[LAST_MEASURED] = seen
    return command


@folded
def start(s: Array, m: Array, setpoint: float, measured: float, standing: float) -> None:
    """Bumpless start: the memory from which `law` returns the present command again if nothing moves.

    Without integral action nothing holds a command.
    """
    held = bounded(standing, s[LOW], s[HIGH])
    # The value that dead-band compensation turns into this command.
    edge = chosen(held > 0.0, s[DEADBAND_HIGH], s[DEADBAND_LOW])
    inside = held / (1.0 + abs(edge) * s[ONSET])
    wish = chosen(abs(inside) * s[ONSET] <= 1.0, inside, held - edge)
    growth = s[KI] * s[SAMPLE_TIME] * (setpoint - measured)
    share = s[KP] * (s[SETPOINT_WEIGHT] * setpoint - measured)
    m[INTEGRAL] = chosen(s[KI] != 0.0, wish - share - growth, 0.0)
    m[SLOPE] = 0.0
    m[SPEED] = 0.0
    # A notch does not change a constant.
    m[NOTCH_1] = wish - s[NOTCH_B0] * wish
    m[NOTCH_2] = s[NOTCH_B2] * wish - s[NOTCH_A2] * wish
    m[LAST_COMMAND] = held
    m[LAST_SETPOINT] = setpoint
    m[LAST_MEASURED] = measured


@folded
def change(s: Array, m: Array, wanted: Array) -> None:
    """Bumpless change to the settings `wanted`: the integral takes over the change of the other parts."""
    before = s[KP] * (s[SETPOINT_WEIGHT] * m[LAST_SETPOINT] - m[LAST_MEASURED]) + s[KD] * m[SLOPE]
    after = (
        wanted[KP] * (wanted[SETPOINT_WEIGHT] * m[LAST_SETPOINT] - m[LAST_MEASURED]) + wanted[KD] * m[SLOPE]
    )
    m[INTEGRAL] = chosen(wanted[KI] != 0.0, m[INTEGRAL] + (before - after), 0.0)


@compiled
def step(s: Array, m: Array, setpoint: float, measured: float) -> float:
    """`law`, to be called from Python."""
    return law(s, m, setpoint, measured)


@compiled
def begin(s: Array, m: Array, setpoint: float, measured: float, standing: float) -> None:
    """`start`, to be called from Python."""
    start(s, m, setpoint, measured, standing)


@compiled
def switch(s: Array, m: Array, wanted: Array) -> None:
    """`change`, to be called from Python."""
    change(s, m, wanted)
