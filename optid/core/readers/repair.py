"""Faults of sensors and loggers that can be put right beyond doubt: counters that wrap, stand-in values, absurd
readings, repeats of samples that were taken at a slower rate. Each is told; what is in doubt is left to the check.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from optid.core.recording import Array, Repair

Flags = NDArray[np.bool_]

ABSURD = 1e9  # times what a signal usually does: no converter shows that and the signal, too
IMPOSSIBLE = 1e20  # the same where such readings are many: rounding beside a signal is no smaller
_FAST = 8.0  # times the fastest other change between samples: a jump that no axis makes
_LEAP = 2.0  # times the same: for further visits to a value that is known to stand in
_RARE = 0.05  # share of the samples that may be faulty for the others to tell what is right
_FEW = 40  # samples: of shorter records nothing is told
_EQUAL = 4.0  # fastest changes by which jumps of one counter may differ
_LIKELY = 0.75  # of the jumps must go against the motion around them
_AROUND = 6  # samples on either side that show the motion around a jump
_FULL_TURNS = (360.0, 2 * math.pi, 400.0, 1.0, 3600.0, 36_000.0, 100.0, 1000.0)
_TURN = 2e-3  # relative: a turn that differs by more is another
_FEWEST_CHANGES = 30
_MOST_CHANGES = 0.75  # of the rows: with more there is nothing that tells repeats from chance
_SHARED = 0.2  # of a channel's samples that may fall on those of another logger by chance
_LONG = 1 << 20  # samples: of longer series blocks show what is usual
_BLOCKS = 16
_OFF_BEAT = 2.0  # rows between which changes of a slower sampling lie around an even beat
_COARSEST = 100  # rows a sample: a longer straight line is motion
_CLEAR = 10.0  # times what rounding bends a straight line: a corner
_REGULAR = 0.9  # of the runs of equal values must be as long as the usual one


def held_between(
    time: Array, values: Mapping[str, Array], held: Mapping[str, bool]
) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Fill a held channel between its samples where it is recorded at a slower rate than the rows.

    Only where its samples come at a regular distance, and only over that distance: what is missing for longer stays so.
    """
    found, notes = dict(values), []
    for role, series in values.items():
        stride = _stride(series)
        if stride < 2 and held.get(role) and _joined(role, values):
            found[role] = _held_on(time, series)
            notes.append(
                f"{role} has no value in the rows of the other channels: it is held there from its last sample"
            )
        if stride < 2:
            continue
        rate = 1 / (float(np.median(np.diff(time))) * stride)
        if held.get(role):
            rows = np.arange(len(series))
            last = np.maximum.accumulate(np.where(np.isfinite(series), rows, 0))
            near = (rows - last <= math.ceil(1.5 * stride)) & np.isfinite(series[last])
            found[role] = np.where(near, series[last], np.nan)
            notes.append(f"{role} has a sample every {stride} rows ({rate:.4g} Hz) and is held between them")
        else:
            notes.append(
                f"{role} has a rate of its own, a sample every {stride} rows ({rate:.4g} Hz): it is measured there"
            )
    return found, tuple(notes)


def _joined(role: str, values: Mapping[str, Array]) -> bool:
    """Loggers with clocks of their own, joined over time: a row holds the one's sample or the other's."""
    own = np.isfinite(values[role])
    if own.all():
        return False
    others = [np.isfinite(series) for name, series in values.items() if name != role]
    apart = [other for other in others if np.count_nonzero(own & other) < _SHARED * np.count_nonzero(other)]
    return bool(apart) and bool((own | np.any(apart, axis=0)).all())


def _held_on(time: Array, series: Array) -> Array:
    """A series held from its samples for as long as it usually takes to the next one."""
    known = np.flatnonzero(np.isfinite(series))
    last = known[np.clip(np.searchsorted(known, np.arange(len(series)), side="right") - 1, 0, None)]
    ago = time - time[last]
    near = (ago >= 0) & (ago <= 1.5 * float(np.median(np.diff(time[known]))))
    return np.where(near, series[last], np.nan)


def _stride(series: Array) -> int:
    """Rows from one sample to the next where they come regularly, else 1."""
    if not 8 <= np.count_nonzero(np.isfinite(series)) <= 0.7 * len(series):
        return 1
    known = np.flatnonzero(np.isfinite(series))
    apart = np.diff(known)
    usual = round(float(np.median(apart)))
    regular = np.abs(apart - usual) <= max(1, 0.1 * usual)
    return usual if usual > 1 and float(regular.mean()) > 0.8 else 1


def repaired(
    values: Mapping[str, Array], held: Mapping[str, bool]
) -> tuple[dict[str, Array], tuple[Repair, ...]]:
    """Channels with what is certainly wrong put right: a wrapped counter unwrapped, other faults made missing.

    Args:
        values: role -> as recorded, shape (samples,), NaN where missing.
        held: roles that hold from sample to sample; only absurd readings are looked for in them.
    """
    found, repairs = dict(values), list[Repair]()
    for role in values:
        steps = (_absurd,) if held.get(role) else (_absurd, _wrapped, _stand_ins, _stale, _interpolated)
        for step in steps:
            for changed, message, row in step(found[role]):
                found[role] = changed
                repairs.append(Repair(role, f"{role} {message}", row))
    return found, tuple(repairs)


def _blocks(series: Array) -> list[Array]:
    """The series, or blocks of it that are spread over a long one."""
    if len(series) <= _LONG:
        return [series]
    size = _LONG // _BLOCKS
    starts = np.linspace(0, len(series) - size, _BLOCKS).astype(int)
    return [series[a : a + size] for a in starts]


def _largest_step(series: Array) -> float:
    """The largest change from sample to sample, missing ones left out."""
    largest, last = 0.0, np.empty(0)
    for a in range(0, len(series), _LONG):
        block = series[a : a + _LONG]
        known = np.concatenate((last, block[np.isfinite(block)]))
        largest = max(largest, float(np.abs(np.diff(known)).max(initial=0.0)))
        last = known[-1:]
    return largest


Change = tuple[Array, str, int]  # the channel put right, what was seen and done, the first row


def _absurd(series: Array) -> Iterator[Change]:
    """Readings beyond anything that a signal with this middle can reach."""
    known = np.concatenate(_blocks(series))
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
    """A counter that begins anew at the end of its range: its jumps are equal, and against the motion around them."""
    if float(np.nanmax(series) - np.nanmin(series)) * 0.5 >= _largest_step(series):
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
    words = modulus[1] if modulus else "the same each time, and the whole range of the values"
    yield (
        changed,
        f"jumps by {whole:.10g} (as recorded; {words}) within a sample, {len(jumps)} times, "
        f"{size / max(fastest, 1e-300):.3g} times its fastest motion: a counter that wraps; it is unwrapped",
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
    """One exact value that stands in for samples that were lost: entered and left by jumps that no axis makes."""
    seen = np.concatenate([np.abs(np.diff(block)) for block in _blocks(series)])
    seen = seen[np.isfinite(seen)]
    if len(series) > _LONG and len(seen) and _largest_step(series) < _LEAP * float(np.quantile(seen, 0.999)):
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


def _stale(series: Array) -> Iterator[Change]:
    """Samples that were repeated because the signal is taken at a slower rate than the rows."""
    y = series
    if len(y) < 4 * _FEWEST_CHANGES or not np.isfinite(y).all():
        return
    if np.mean(np.concatenate([np.diff(block) != 0 for block in _blocks(y)])) > _MOST_CHANGES:
        return
    steps = np.diff(y)
    changes = np.flatnonzero(steps != 0) + 1
    ratio = _rows_a_sample(changes, len(y))
    if ratio is None:
        return
    sizes = np.abs(steps[changes - 1])
    if float(np.median(sizes)) < 1.5 * float(sizes.min()) and float(np.quantile(sizes, 0.9)) < 1.5 * float(
        sizes.min()
    ):
        return  # it moves by one step of its grid at a time: slow, not stale
    yield (
        _only_at(y, np.r_[0, changes]),
        f"is new only in every {_ordinal(ratio)} row: in between, the last value is repeated; the repeats are not "
        f"counted as samples, and its true rate is 1/{ratio:.3g} of the rows'",
        int(changes[0]),
    )


def _interpolated(series: Array) -> Iterator[Change]:
    """Samples that a logger put on straight lines between those that were taken at a slower rate."""
    y = series
    if len(y) < 4 * _FEWEST_CHANGES or not np.isfinite(y).all():
        return
    glimpse = np.concatenate([np.abs(np.diff(block, 2)) for block in _blocks(y)])
    if float(np.median(glimpse)) > 2.1 * float(np.min(glimpse[glimpse > 0], initial=np.inf)) and float(
        np.median(glimpse)
    ) > 1e-6 * float(np.ptp(y)):
        return  # more than half of its samples are corners
    bends = np.abs(np.diff(y, 2))
    grid = float(np.min(np.abs(np.diff(np.unique(y[:20_000])))[1:], initial=np.inf))
    straight = max(1e-9 * float(np.ptp(y)), 2.1 * grid if grid < 1e-3 * float(np.ptp(y)) else 0.0)
    corners = np.flatnonzero(bends > straight) + 1
    ratio = _rows_a_sample(corners, len(y))
    if (
        ratio is None
        or not 2 <= ratio <= _COARSEST
        or float(np.median(bends[corners - 1])) < _CLEAR * straight
    ):
        return
    stride = round(ratio)
    taken = np.arange(int(corners[0]) % stride, len(y), stride)
    if abs(ratio - stride) > 0.02 or not np.isin(corners, taken).mean() > _REGULAR:
        return
    yield (
        _only_at(y, taken),
        f"goes on straight between every {_ordinal(ratio)} row: a logger interpolated it; what lies between is not "
        f"counted as samples, and its true rate is 1/{ratio:.3g} of the rows'",
        int(taken[0]),
    )


def _only_at(y: Array, rows: NDArray[np.int64]) -> Array:
    kept = np.full(len(y), np.nan)
    kept[rows] = y[rows]
    return kept


def _rows_a_sample(changes: NDArray[np.int64], rows: int) -> float | None:
    """How many rows a sample lasts, if the changes come as regularly as those of a slower sampling do."""
    if not _FEWEST_CHANGES <= len(changes) <= _MOST_CHANGES * rows:
        return None
    apart = np.diff(changes)
    usual = round(float(np.median(apart)))
    near = np.abs(apart - usual) <= (0 if usual < 4 else 1)
    # At rest a value stays for several periods.
    whole = (apart > usual) & (
        np.abs(apart / usual - np.round(apart / usual)) * usual <= (0 if usual < 4 else 1)
    )
    if usual >= 2 and float((near | whole).mean()) >= _REGULAR + 0.05 and float(near.mean()) >= 0.6:
        return float(usual)
    ratio = float(changes[-1] - changes[0]) / (len(changes) - 1)
    off = changes - changes[0] - ratio * np.arange(len(changes))
    return ratio if float(np.ptp(off)) <= _OFF_BEAT else None


def _ordinal(ratio: float) -> str:
    n = round(ratio)
    if abs(ratio - n) > 0.02:
        return f"{ratio:.3g}th"
    end = "th" if 10 <= n % 100 <= 20 else {1: "st", 2: "nd", 3: "rd"}.get(n % 10, "th")
    return f"{n}{end}"
