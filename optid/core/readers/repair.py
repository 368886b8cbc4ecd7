"""Faults of sensors and loggers that can be corrected without doubt: counters that wrap, placeholder values, absurd
readings, repeats of samples taken at a slower rate. Each is noted; doubtful ones are left to the check."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from optid.core.readers.glimpses import LONG, blocks, largest_step
from optid.core.readers.repeats import Change, interpolated, stale
from optid.core.recording import Array, Repair

Flags = NDArray[np.bool_]

ABSURD = 1e9  # times the usual size of a signal: no converter resolves both
IMPOSSIBLE = 1e20  # the same if such readings are many: rounding of a signal is no smaller
_FAST = 8.0  # times the fastest other change between samples: a jump that no axis makes
_LEAP = 2.0  # the same, for further visits to a value already known as a placeholder
_RARE = 0.05  # share of the samples that may be faulty while the others still show what is right
_FEW = 40  # samples: shorter recordings are not judged
_EQUAL = 4.0  # times the fastest change, by which jumps of one counter may differ
_LIKELY = 0.75  # of the jumps must go against the motion around them
_AROUND = 6  # samples on either side that show the motion around a jump
_FULL_TURNS = (360.0, 2 * math.pi, 400.0, 1.0, 3600.0, 36_000.0, 100.0, 1000.0)
_TURN = 2e-3  # relative: periods that differ by more are different


def repaired(
    values: Mapping[str, Array], held: Mapping[str, bool]
) -> tuple[dict[str, Array], tuple[Repair, ...]]:
    """Channels with certain faults corrected: a wrapped counter is unwrapped, other faults become missing samples.

    Args:
        values: role -> as recorded, shape (samples,), NaN where missing.
        held: roles that hold from sample to sample; only absurd readings are looked for in them.
    """
    found, repairs = dict(values), list[Repair]()
    for role in values:
        steps = (_absurd,) if held.get(role) else (_absurd, _wrapped, _stand_ins, stale, interpolated)
        for step in steps:
            for changed, message, row in step(found[role]):
                found[role] = changed
                repairs.append(Repair(role, f"{role} {message}", row))
    return found, tuple(repairs)


def _absurd(series: Array) -> Iterator[Change]:
    """Readings beyond anything that a signal with this median can reach."""
    known = np.concatenate(blocks(series))
    known = known[np.isfinite(known)]
    if len(known) < _FEW:
        return
    low, middle, high = np.percentile(known, (5, 50, 95))
    moved = np.abs(known - middle)
    usual = float(np.median(moved[moved > 0])) if (moved > 0).any() else 0.0
    floor = max(abs(middle) * 1e-3, usual, np.finfo(float).tiny)
    limit = min(ABSURD * max(high - low, floor), IMPOSSIBLE * floor)
    if max(np.nanmax(series) - middle, middle - np.nanmin(series)) <= limit:
        return
    with np.errstate(over="ignore"):
        far: Flags = np.abs(series - middle) > limit
    if not far.any() or far.mean() > (0.5 if limit == IMPOSSIBLE * floor else _RARE):
        return
    low, high = np.percentile(series[np.isfinite(series) & ~far], (5, 95))
    row = int(far.argmax())
    extreme = float(series[far][np.abs(series[far]).argmax()])
    yield (
        np.where(far, np.nan, series),
        f"reads {extreme:.4g} (as recorded) where nearly all of it lies within {low:.4g} to {high:.4g}: "
        f"{int(far.sum())} such samples count as missing",
        row,
    )


def _wrapped(series: Array) -> Iterator[Change]:
    """A counter that restarts at the end of its range: its jumps are equal, and against the motion around them."""
    if float(np.nanmax(series) - np.nanmin(series)) * 0.5 >= largest_step(series):
        return
    known = np.flatnonzero(np.isfinite(series))
    y = series[known]
    if len(y) < _FEW:
        return
    steps = np.diff(y)
    span = float(y.max() - y.min())
    jumps = np.flatnonzero(np.abs(steps) > 0.5 * span)
    if not len(jumps) or len(jumps) > _RARE * len(y):
        return
    others = np.abs(np.delete(steps, jumps))
    fastest = float(others.max())
    around = np.array([_motion(steps, jumps, int(k)) for k in jumps])
    sizes = np.abs(steps[jumps] - around)
    size = float(np.median(sizes))
    if size < _FAST * fastest or np.abs(sizes - size).max() > _EQUAL * fastest or span < size - 4 * fastest:
        return
    if float(np.mean(np.sign(steps[jumps]) * around < 0)) < _LIKELY:
        return
    modulus = _modulus(y, size, fastest)
    if modulus is None and len(jumps) < 2:
        return
    whole = modulus[0] if modulus else size
    turns = np.concatenate(([0.0], np.cumsum(np.where(np.abs(steps) > 0.5 * span, -np.sign(steps), 0.0))))
    changed = series.copy()
    changed[known] = y + whole * turns
    words = modulus[1] if modulus else "the same each time, and equal to the whole range of the values"
    yield (
        changed,
        f"jumps by {whole:.10g} (as recorded; {words}) within a sample, {len(jumps)} times, "
        f"{size / max(fastest, 1e-300):.3g} times its fastest motion: a counter that wraps; it was unwrapped",
        int(known[jumps[0] + 1]),
    )


def _motion(steps: Array, jumps: NDArray[np.int64], k: int) -> float:
    """Mean change between samples around a jump, without other jumps."""
    near = np.arange(max(k - _AROUND, 0), min(k + _AROUND + 1, len(steps)))
    near = near[~np.isin(near, jumps)]
    return float(steps[near].mean()) if len(near) else 0.0


def _modulus(y: Array, size: float, fastest: float) -> tuple[float, str] | None:
    """The exact size of a turn: a power of two of the values' grid, or a round angle."""
    levels = np.unique(y[:200_000])
    gaps = np.diff(levels)
    gaps = gaps[gaps > 1e-9 * max(abs(levels[0]), abs(levels[-1]), 1e-300)]
    grid = float(gaps.min()) if len(gaps) else 0.0
    if grid > 0 and np.abs(levels / grid - np.round(levels / grid)).max() < 0.05:
        bits = round(math.log2(size / grid))
        if 6 <= bits <= 40 and abs(size / grid - 2.0**bits) * grid <= max(fastest, 3 * grid):
            return 2.0**bits * grid, f"2^{bits} steps of {grid:.6g}"
    for turn in _FULL_TURNS:
        if abs(size - turn) <= min(fastest, _TURN * turn):
            return turn, "a full turn"
    return None


def _stand_ins(series: Array) -> Iterator[Change]:
    """One exact value used as a placeholder for lost samples: entered and left by jumps that no axis makes."""
    seen = np.concatenate([np.abs(np.diff(block)) for block in blocks(series)])
    seen = seen[np.isfinite(seen)]
    if len(series) > LONG and len(seen) and largest_step(series) < _LEAP * float(np.quantile(seen, 0.999)):
        return
    known = np.flatnonzero(np.isfinite(series))
    y = series[known]
    if len(y) < _FEW:
        return
    steps = np.abs(np.diff(y))
    count = max(int(0.02 * len(steps)), 12)
    largest = np.argpartition(steps, -min(count, len(steps)))[-count:]
    landed, times = np.unique(np.concatenate((y[largest], y[largest + 1])), return_counts=True)
    for value in landed[np.argsort(-times)[:2]]:
        flagged = _visits(y, float(value))
        if flagged is None:
            continue
        rows = known[flagged]
        changed = series.copy()
        changed[rows] = np.nan
        neighbours = np.abs(np.median(y[~flagged]) - value)
        yield (
            changed,
            f"reads exactly {value:.6g} (as recorded) in {len(rows)} samples, entered and left by jumps that it never "
            f"makes otherwise (its middle is {neighbours:.4g} away): dropouts; they count as missing",
            int(rows[0]),
        )
        return


def _visits(y: Array, value: float) -> Flags | None:
    """Samples at a value whose stretch begins and ends with a jump; None if this is how the signal moves."""
    at = y == value
    steps = np.abs(np.diff(y))
    inner = steps[~(at[1:] | at[:-1])]
    if not len(inner) or at.sum() > 0.2 * len(y):
        return None
    usual = float(np.quantile(inner, 0.999))
    if usual == 0.0:
        return None
    # How far it is between the samples on both sides of a stretch is the motion during it, which may be fast.
    edges = np.flatnonzero(np.diff(np.concatenate(([False], at, [False])).astype(np.int8)))
    flagged = np.zeros(len(y), dtype=bool)
    visits = 0
    for a, b in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        jumps = [steps[k] for k, is_there in ((a - 1, a > 0), (b - 1, b < len(y))) if is_there]
        # Once three are beyond doubt, shorter leaps to the very same value are of the same kind.
        flagged[a:b] = bool(jumps) and min(jumps) > _LEAP * usual
        visits += bool(jumps) and min(jumps) > _FAST * usual
    return flagged if visits >= 3 else None
