"""Time: from the rig's time column or the file's clocks, unwrapped, checked, and common to all channels."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from optid.core.readers.table import Clock
from optid.errors import RecordingError

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

# Periods after which clocks and counters restart, in their own unit: bits; a week (GPS), a day, an hour, a minute,
# also in ms, us and ns.
_BITS = tuple(2.0**n for n in (8, 10, 12, 14, 16, 20, 24, 31, 32, 48, 64))
_DAYS = tuple(
    base * size for base in (604_800.0, 86_400.0, 43_200.0, 3600.0, 60.0) for size in (1.0, 1e3, 1e6, 1e9)
)
_SCALED = tuple(
    2.0**n * size for n in (16, 24, 31, 32) for size in (1e-9, 1e-8, 1e-7, 1e-6, 1e-4, 1e-3, 1e-2)
)
_TENS = tuple(
    10.0**n for n in range(10)
)  # recordings may have such a length: these count only from the second restart
PERIODS = (*_BITS, *_DAYS, *_SCALED, 24.0, 1440.0, *_TENS)
_MANY = 50  # samples per restart, at least: a column that restarts more often is not a clock
_LOST = 60.0  # s that may be missing over midnight
_BURST = 0.5  # of the mean interval: scatter of time stamps beyond which bursts are looked for
_HURRIED = 3  # percent of the intervals that must be short: samples that were delayed arrive together
_FEWEST = 60  # samples from which bursts can be detected
_SAME_RATE = 2e-3  # relative: rates that differ by more contradict each other


def unwrapped(raw: Array, unit: str, place: Callable[[int], str]) -> tuple[Array, tuple[str, ...]]:
    """Times with the restarts of the clock unwrapped, and a note.

    Only if every step back is that of one known period (midnight, a counter's bits) to within a few intervals.

    Args:
        raw: as recorded, without missing values.
        unit: in which they are recorded.
        place: where a row stands.
    """
    back = np.flatnonzero(np.diff(raw) < 0)
    if not len(back) or len(back) * _MANY > len(raw):
        return raw, ()
    step = float(np.median(np.diff(raw)))
    fallen = raw[back] - raw[back + 1]
    for period in PERIODS:
        missed = period - fallen  # from the last sample before to the first after
        most = max(5 * step, _LOST / 86_400.0 * period * _is_day(period)) + 1e-9 * period
        seldom = period in _TENS and len(back) < 2
        if (missed > 0).all() and (missed <= most).all() and (raw < 1.001 * period).all() and not seldom:
            turns = np.zeros(len(raw))
            turns[back + 1] = period
            times = "once" if len(back) == 1 else f"{len(back)} times"
            what = "midnight" if _is_day(period) else "the counter's range"
            return raw + np.cumsum(turns), (
                f"the clock restarts {times} ({place(int(back[0]) + 1)}): "
                f"{period:.10g} {unit} are added from that row on ({what})",
            )
    return raw, ()


def _is_day(period: float) -> bool:
    return period in {86_400.0 * size for size in (1.0, 1e3, 1e6, 1e9)} or period in (24.0, 1440.0)


def refuse_bursts(time: Array, field: str, path: Path) -> None:
    """Refuse time stamps of arrival: the samples were taken evenly, but arrived in bursts.

    Raises:
        RecordingError: the intervals scatter by half an interval or more, yet the stamps keep to a straight line.
    """
    steps = np.diff(time)
    mean = float(steps.mean())
    if len(time) < _FEWEST or float(np.std(steps)) < _BURST * mean:
        return
    n = np.arange(len(time), dtype=np.float64)
    centred = n - n.mean()
    slope = float(centred @ (time - time.mean()) / (centred @ centred))
    off = np.abs(time - time.mean() - slope * centred)
    # A gap, a changing rate or random intervals depart from the line further and further; bursts by less than a burst.
    if float(off.max()) > float(steps.max()):
        return
    short, long = float(np.percentile(steps, _HURRIED)), float(np.percentile(steps, 95))
    if short > _BURST * slope:  # a gap among even samples
        return
    long = max(long, float(np.median(steps[steps > 2 * slope]))) if (steps > 2 * slope).any() else long
    raise RecordingError(
        f"the time stamps come in bursts, {short:.3g} to {long:.3g} s apart, while on the whole a sample was taken "
        "every "
        f"{slope:.4g} s: they record when samples arrived, not when they were taken",
        where=path,
        field=field,
        expected="times of the samples",
        hint=f'state rate = "{1 / slope:.4g} Hz" instead of a time column',
    )


@dataclass(frozen=True, eq=False)
class Aligned:
    """Signals on one clock.

    Attributes:
        time: s, shape (samples,).
        values: role -> shape (samples,).
        notes: what was done.
    """

    time: Array
    values: Mapping[str, Array]
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Timed:
    """A signal with its own clock; `held` holds from each sample to the next."""

    values: Array
    clock: Clock
    held: bool


def aligned(signals: Mapping[str, Timed], path: Path) -> Aligned:
    """Align signals of several clocks to the fastest one, over the time that all of them cover.

    A held signal (a command) has at each instant the value of its last sample. A measured one is interpolated by
    cubics if its rate is the clock's; if it is slower, each sample is placed at the nearest instant.

    Raises:
        RecordingError: they have no stretch in common.
    """
    origin = min(one.clock.origin for one in signals.values())
    times = {role: one.clock.seconds + (one.clock.origin - origin) * 1e-9 for role, one in signals.items()}
    steps = {role: float(np.median(np.diff(t))) for role, t in times.items()}
    start, stop = max(t[0] for t in times.values()), min(t[-1] for t in times.values())
    lead = _lead(signals, steps)
    kept = (times[lead] >= start - 1e-6 * steps[lead]) & (times[lead] <= stop + 1e-6 * steps[lead])
    axis = times[lead][kept]
    if len(axis) < 2:
        raise RecordingError(
            "the channels were not recorded at the same time",
            where=path,
            expected="channels whose clocks overlap",
            hint=_spans(times),
        )
    values = {}
    for role, one in signals.items():
        if role == lead or (
            len(times[role]) == len(times[lead]) and np.array_equal(times[role], times[lead])
        ):
            values[role] = one.values[kept]
        elif one.held:
            values[role] = _held(axis, times[role], one.values, steps[lead])
        else:
            values[role] = _measured(axis, times[role], one.values, steps[lead], steps[role])
    zero = axis[0] if signals[lead].clock.origin or abs(axis[0]) > 1e5 else 0.0
    return Aligned(axis - zero, values, _told(signals, times, steps, start, stop))


def _lead(signals: Mapping[str, Timed], steps: Mapping[str, float]) -> str:
    """The role with the fastest clock; of equally fast ones a command's."""
    fastest = min(steps.values())
    quick = [role for role in signals if steps[role] <= fastest * (1 + _SAME_RATE)]
    return next((role for role in quick if signals[role].held), quick[0])


def _held(axis: Array, at: Array, values: Array, step: float) -> Array:
    index = np.searchsorted(at, axis + 1e-6 * step, side="right") - 1
    return values[np.clip(index, 0, len(values) - 1)]


def _measured(axis: Array, at: Array, values: Array, step: float, own: float) -> Array:
    nearest = np.searchsorted(at, axis)
    low = np.clip(nearest - 1, 0, len(at) - 1)
    high = np.clip(nearest, 0, len(at) - 1)
    off = np.minimum(np.abs(axis - at[low]), np.abs(at[high] - axis))
    if float(off.max()) <= 1e-4 * step:
        return values[np.where(np.abs(axis - at[low]) <= np.abs(at[high] - axis), low, high)]
    smooth = _cubic(axis, at, values)
    if own <= step * (1 + _SAME_RATE):
        return smooth
    rows = np.clip(np.round((at - axis[0]) / step), 0, len(axis) - 1).astype(np.int64)
    rows = rows[np.abs(axis[rows] - at) <= 0.51 * step]
    sparse = np.full(len(axis), np.nan)
    sparse[rows] = smooth[rows]
    return sparse


def _cubic(axis: Array, at: Array, values: Array) -> Array:
    """Cubic interpolation through the four neighbours (Lagrange), missing where one of the two nearest is."""
    if len(at) < 4:
        return np.interp(axis, at, values)
    left = np.clip(np.searchsorted(at, axis, side="right") - 2, 0, len(at) - 4)
    rows = left[:, None] + np.arange(4)
    t, y = at[rows], values[rows]
    found = np.zeros(len(axis))
    for i in range(4):
        weight = np.ones(len(axis))
        for j in range(4):
            if i != j:
                weight *= (axis - t[:, j]) / (t[:, i] - t[:, j])
        found += weight * y[:, i]
    rough = np.interp(axis, at, values)
    return np.where(np.isfinite(found), found, rough)


def _spans(times: Mapping[str, Array]) -> str:
    return "; ".join(f"{role} from {t[0]:.6g} to {t[-1]:.6g} s" for role, t in list(times.items())[:4])


def _told(
    signals: Mapping[str, Timed],
    times: Mapping[str, Array],
    steps: Mapping[str, float],
    start: float,
    stop: float,
) -> tuple[str, ...]:
    notes = []
    first = min(t[0] for t in times.values())
    late = {role: float(t[0] - first) for role, t in times.items()}
    last = max(late, key=lambda role: late[role])
    if late[last] > 1e-6:
        begins = ", ".join(f"{role} {1e3 * s:.6g} ms" for role, s in late.items() if s > 1e-9)
        notes.append(
            f"according to the file's clocks the channels begin at different times (later than the first: {begins}): "
            f"they are aligned by these times, over the {stop - start:.6g} s that they share"
        )
    rates = {role: 1 / step for role, step in steps.items()}
    if max(rates.values()) > min(rates.values()) * (1 + _SAME_RATE):
        each = ", ".join(f"{role} {rate:.6g} Hz" for role, rate in rates.items())
        notes.append(
            f"the channels have different rates ({each}): each counts as measured where it has samples"
        )
    return tuple(notes)


def contradicted(stated: float, clock: Clock) -> float | None:
    """The clock's rate in Hz where it contradicts the one stated in the rig file."""
    step = float(np.median(np.diff(clock.seconds))) if len(clock.seconds) > 1 else math.nan
    if not step > 0 or abs(step * stated - 1) <= _SAME_RATE:
        return None
    return 1 / step
