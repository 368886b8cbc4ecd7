"""Channels with samples in some of the rows only: a held one is filled between them, a measured one is not."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


_SHARED = 0.2  # of a channel's samples that may coincide with another logger's by chance


def held_between(
    time: Array, values: Mapping[str, Array], held: Mapping[str, bool]
) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Fill a held channel between its samples where it is recorded at a slower rate than the rows.

    Only if its samples are regularly spaced, and only over that spacing: longer gaps remain.
    """
    found, notes = dict(values), []
    for role, series in values.items():
        apart = sample_stride(series)
        if apart < 2 and held.get(role) and _joined(role, values):
            found[role] = _held_on(time, series)
            notes.append(
                f"{role} has no value in the rows of the other channels: its last sample is held there"
            )
        if apart < 2:
            continue
        rate = 1 / (float(np.median(np.diff(time))) * apart)
        if held.get(role):
            rows = np.arange(len(series))
            last = np.maximum.accumulate(np.where(np.isfinite(series), rows, 0))
            near = (rows - last <= math.ceil(1.5 * apart)) & np.isfinite(series[last])
            found[role] = np.where(near, series[last], np.nan)
            notes.append(f"{role} has a sample every {apart} rows ({rate:.4g} Hz) and is held between them")
        else:
            notes.append(
                f"{role} has its own rate, a sample every {apart} rows ({rate:.4g} Hz): it counts as measured there"
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
    """A series held from each sample for the usual time to the next one."""
    known = np.flatnonzero(np.isfinite(series))
    last = known[np.clip(np.searchsorted(known, np.arange(len(series)), side="right") - 1, 0, None)]
    ago = time - time[last]
    near = (ago >= 0) & (ago <= 1.5 * float(np.median(np.diff(time[known]))))
    return np.where(near, series[last], np.nan)


def sample_stride(series: Array) -> int:
    """Rows from one sample to the next where they come regularly, else 1."""
    if not 8 <= np.count_nonzero(np.isfinite(series)) <= 0.7 * len(series):
        return 1
    known = np.flatnonzero(np.isfinite(series))
    apart = np.diff(known)
    usual = round(float(np.median(apart)))
    regular = np.abs(apart - usual) <= max(1, 0.1 * usual)
    return usual if usual > 1 and float(regular.mean()) > 0.8 else 1
