"""Samples that cannot come from the axis: faults that the reader corrected, and remaining jumps and outliers."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from optid.core.recording import Recording
from optid.quality.remark import Remark

Array = NDArray[np.float64]

_FAST = 20.0  # times the fastest other change between samples
_FEW_JUMPS, _MOST_JUMPS, _RARE = 5, 200, 0.005  # of the samples that jump
_BESIDE = 3.0  # times the fastest motion, for a step not preceded by motion
_SPIKE = 15.0  # standard deviations away from the neighbours
_BEYOND = 6.0  # times the deviation of 97 of 100 samples from their neighbours
_SHOWN = 4  # samples named in a message


def repaired(recording: Recording) -> Iterator[Remark]:
    """Faults in the file that were corrected while it was read."""
    for repair in recording.provenance.repairs if recording.provenance else ():
        at = float(recording.time[min(repair.row, len(recording) - 1)])
        yield Remark("repaired", "warning", repair.role, f"{repair.message} (first at {at:.6g} s)", (at, at))


def jumps(recording: Recording, outputs: tuple[str, ...], positions: tuple[str, ...]) -> Iterator[Remark]:
    """Steps of an output that no axis makes: lost counts, a new zero, two recordings in one file.

    A position has a speed: a step of it is also compared with the motion around it, which shows smaller ones.
    """
    for role in outputs:
        values = recording[role].values
        known = np.flatnonzero(np.isfinite(values))
        y, t = values[known], recording.time[known]
        if len(y) < 40:
            continue
        steps = np.diff(y)
        steps[np.diff(t) > 1.5 * float(np.median(np.diff(t)))] = 0.0  # across a gap an axis may move far
        far, usual = _far(steps, _FAST)
        if role in positions:
            off, _ = _far(steps - _motion_around(steps), _FAST)
            usual = float(np.abs(np.delete(steps, np.union1d(far, off))).max(initial=0.0))
            beyond = np.abs(steps[off]) > _BESIDE * usual
            far = np.union1d(far, off[beyond])
        stays = [int(k) for k in far if _stays(y, int(k))]
        if not stays or usual == 0.0:
            continue
        size, first = float(np.abs(steps[stays]).max()), stays[0]
        yield Remark(
            "jump",
            "error" if role in positions else "warning",
            role,
            f"{role} jumps by {size:.4g} {recording[role].unit} within a sample ({len(stays)} such steps, first at "
            f"{t[first + 1]:.6g} s), {size / usual:.3g} times its fastest motion: lost counts, a new zero, a bad "
            "contact, or two recordings in one file; cut the file there",
            (float(t[first]), float(t[first + 1])),
        )


def _far(steps: Array, times: float) -> tuple[NDArray[np.int64], float]:
    """Rows of the few steps that exceed all others by this factor, and the size of the others."""
    sizes = np.abs(steps)
    few = max(_FEW_JUMPS, min(int(_RARE * len(steps)), _MOST_JUMPS))
    order = (
        np.argpartition(sizes, -(few + 1))[-(few + 1) :] if few + 1 < len(sizes) else np.arange(len(sizes))
    )
    order = order[np.argsort(-sizes[order], kind="stable")]
    # Jumps are separated from motion where the sorted sizes fall most steeply.
    top = sizes[order[: few + 1]]
    ratios = top[:-1] / np.maximum(top[1:], max(float(top[0]) * 1e-12, 1e-300))
    cut = int(ratios.argmax())
    usual = float(top[cut + 1])
    return np.sort(order[: few + 1][top > times * usual]), usual


def _motion_around(steps: Array) -> Array:
    """The median of the four steps around each."""
    padded = np.pad(steps, 2, mode="edge")
    n = len(steps)
    _, low, high, _ = _sorted_four(*(padded[k : k + n] for k in (0, 1, 3, 4)))
    return (low + high) / 2


def _sorted_four(a: Array, b: Array, c: Array, d: Array) -> tuple[Array, Array, Array, Array]:
    """Four arrays of one shape sorted among each other, row by row; faster than sorting their stack."""
    a, b = np.minimum(a, b), np.maximum(a, b)
    c, d = np.minimum(c, d), np.maximum(c, d)
    first, one, other, last = np.minimum(a, c), np.maximum(a, c), np.minimum(b, d), np.maximum(b, d)
    return first, np.minimum(one, other), np.maximum(one, other), last


def _stays(y: Array, k: int) -> bool:
    """Whether the levels before and after a step last for some samples: then it is not an outlier."""
    size, before, after = abs(y[k + 1] - y[k]), y[max(k - 5, 0) : k + 1], y[k + 1 : k + 7]
    held = bool(np.abs(after - y[k + 1]).max() < 0.5 * size and np.abs(before - y[k]).max() < 0.5 * size)
    return held and len(after) > 2 and len(before) > 2


def outliers(recording: Recording, outputs: tuple[str, ...]) -> Iterator[Remark]:
    """Single samples far off their neighbours."""
    for role in outputs:
        values = recording[role].values
        known = np.flatnonzero(np.isfinite(values))
        y = values[known]
        if len(y) < 40:
            continue
        far, off = _alone(y, 0)
        if not len(far):
            far, off = _alone(y, 2)  # a filter after the sensor spreads a spike over a few samples
        if not len(far):
            continue
        places = ", ".join(f"{recording.time[known[k]]:.6g}" for k in far[:_SHOWN])
        yield Remark(
            "outliers",
            "warning",
            role,
            f"{len(far)} samples of {role} are isolated, up to {off.max():.3g} {recording[role].unit} off "
            f"their neighbours (at {places}{' s ...' if len(far) > _SHOWN else ' s'}): leave them out, or fit with "
            "--robust",
            (float(recording.time[known[far[0]]]),) * 2,
        )


def _alone(y: Array, apart: int) -> tuple[NDArray[np.int64], Array]:
    """Rows of samples far from the two before and the two after them, `apart` left out between; and the distance."""
    reach = 2 + apart
    n = len(y) - 2 * reach
    first, low, high, last = _sorted_four(*(y[k : k + n] for k in (0, 1, 2 * reach - 1, 2 * reach)))
    off = np.abs(y[reach:-reach] - (low + high) / 2)
    limit = max(_SPIKE * 1.4826 * float(np.median(off)), _BEYOND * float(np.quantile(off, 0.97)))
    spread = last - first  # the neighbours must agree: a step is not an outlier
    far = np.flatnonzero((off > limit) & (spread < 0.5 * off)) if limit > 0.0 else np.empty(0, dtype=np.int64)
    return far + reach, off[far]
