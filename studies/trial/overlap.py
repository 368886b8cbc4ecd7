"""How well flagged intervals meet the true ones: intersection over union."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from studies.independent_rig.rig import Array
from studies.trial.record import SECONDS

GRID = 5e-3  # s


def interval_overlap(one: tuple[float, float], other: tuple[float, float]) -> float:
    """Of two ranges."""
    shared = max(min(one[1], other[1]) - max(one[0], other[0]), 0.0)
    whole = max(one[1], other[1]) - min(one[0], other[0])
    return shared / whole if whole > 0.0 else 0.0


def time_overlap(
    flagged: Iterable[tuple[str, float, float]], true: Mapping[str, Iterable[tuple[float, float]]]
) -> tuple[float, float] | None:
    """Overlap over the recordings in which anything is flagged, and that of flagging all of them; None if none is."""
    by_name: dict[str, list[tuple[float, float]]] = {}
    for file, begin, end in flagged:
        by_name.setdefault(Path(file).stem, []).append((begin, end))
    masks = [(_mask(by_name[name]), _mask(true[name])) for name in by_name if name in true]
    if not masks:
        return None
    said, is_so = (np.concatenate(part) for part in zip(*masks, strict=True))
    either = np.sum(said | is_so)
    return (float(np.sum(said & is_so) / either) if either else 0.0), float(np.mean(is_so))


def _mask(intervals: Iterable[tuple[float, float]]) -> Array:
    t = np.arange(round(SECONDS / GRID)) * GRID
    mask = np.zeros(len(t), dtype=bool)
    for begin, end in intervals:
        mask |= (t >= begin) & (t < end)
    return mask
