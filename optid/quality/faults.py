"""Samples that cannot be the axis's: what the reader put right, and jumps and outliers that are left."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from optid.core.recording import Recording
from optid.quality.remark import Remark

Array = NDArray[np.float64]

_FAST = 20.0  # times the fastest other change between samples
_FEW_JUMPS = 5
_SPIKE = 15.0  # standard deviations off the neighbours
_BEYOND = 6.0  # times what 97 of 100 samples are off them
_SHOWN = 4  # samples named


def repaired(recording: Recording) -> Iterator[Remark]:
    """What was wrong in the file and was put right while it was read."""
    for repair in recording.provenance.repairs if recording.provenance else ():
        at = float(recording.time[min(repair.row, len(recording) - 1)])
        yield Remark("repaired", "warning", repair.role, f"{repair.message} (first at {at:.6g} s)", (at, at))


def jumps(recording: Recording, outputs: tuple[str, ...], positions: tuple[str, ...]) -> Iterator[Remark]:
    """Steps of an output that no axis makes: lost counts, a new zero, two recordings in one file."""
    for role in outputs:
        values = recording[role].values
        known = np.flatnonzero(np.isfinite(values))
        y, t = values[known], recording.time[known]
        if len(y) < 40:
            continue
        steps = np.diff(y)
        steps[np.diff(t) > 1.5 * float(np.median(np.diff(t)))] = 0.0  # across a gap an axis may move far
        largest = np.argsort(-np.abs(steps))[: _FEW_JUMPS + 1]
        sizes = np.abs(steps[largest])
        usual = float(sizes[-1])
        far = np.sort(largest[sizes > _FAST * usual])
        stays = [int(k) for k in far if _stays(y, int(k))]
        if not stays or usual == 0.0:
            continue
        size, first = float(np.abs(steps[stays]).max()), stays[0]
        yield Remark(
            "jump",
            "error" if role in positions else "warning",
            role,
            f"{role} jumps by {size:.4g} {recording[role].unit} within a sample ({len(stays)} such steps, first at "
            f"{t[first + 1]:.6g} s), {size / usual:.3g} times its fastest motion: counts lost, a new zero, or two "
            "recordings in one; cut the file there",
            (float(t[first]), float(t[first + 1])),
        )


def _stays(y: Array, k: int) -> bool:
    """The level after a step is still there some samples later: it is no outlier."""
    after, size = y[k + 1 : k + 7], y[k + 1] - y[k]
    return len(after) > 2 and bool(np.abs(after - y[k + 1]).max() < 0.5 * abs(size))


def outliers(recording: Recording, outputs: tuple[str, ...]) -> Iterator[Remark]:
    """Single samples far off their neighbours."""
    for role in outputs:
        values = recording[role].values
        known = np.flatnonzero(np.isfinite(values))
        y = values[known]
        if len(y) < 40:
            continue
        around = np.sort(np.stack((y[:-4], y[1:-3], y[3:-1], y[4:])), axis=0)
        off = np.abs(y[2:-2] - (around[1] + around[2]) / 2)
        limit = max(_SPIKE * 1.4826 * float(np.median(off)), _BEYOND * float(np.quantile(off, 0.97)))
        spread = np.abs(around[3] - around[0])  # neighbours that agree: a step is no outlier
        far = np.flatnonzero((off > limit) & (spread < 0.5 * off)) + 2
        if not len(far) or limit == 0.0:
            continue
        places = ", ".join(f"{recording.time[known[k]]:.6g}" for k in far[:_SHOWN])
        yield Remark(
            "outliers",
            "warning",
            role,
            f"{len(far)} samples of {role} stand alone, up to {off[far - 2].max():.3g} {recording[role].unit} off "
            f"their neighbours (at {places}{' s ...' if len(far) > _SHOWN else ' s'}): leave them out, or let them "
            "count less (fit --robust)",
            (float(recording.time[known[far[0]]]),) * 2,
        )
