"""The demanded position over time: levels with the moments at which they begin, or a recorded profile."""

from __future__ import annotations

import itertools
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from optid.core.paths import is_file
from optid.core.readers import read_recording
from optid.core.units import to_si
from optid.errors import InputError
from optid.live.settings import Limits
from optid.rigs.channels import REFERENCE
from optid.rigs.rigfile import Rig

HOLD = 2.0  # s at each level of the default tour
TOUR = (0.0, 0.5, -0.5, 0.25, 0.75, -0.25, -0.75)  # levels of it, as shares of the stroke limits' half


@dataclass(frozen=True)
class Reference:
    """Values (m) that hold from their times (s, increasing, the first one 0) on; a `period` repeats them."""

    times: tuple[float, ...]
    values: tuple[float, ...]
    period: float | None = None

    def at(self, time: float) -> float:
        """The demanded position."""
        if self.period is not None:
            time %= self.period
        return self.values[max(bisect_right(self.times, time) - 1, 0)]


def tour(limits: Limits) -> Reference:
    """Steps over the middle part of the stroke, again and again.

    Raises:
        InputError: the stroke's limits are not known.
    """
    low, high = limits.stroke
    if not high - low < float("inf"):
        raise InputError(
            "the rig file states no stroke, so no tour of it is known",
            where="--reference",
            expected='a position, "0:0 mm, 2:60 mm, 5:-40 mm", or a recording with a reference',
        )
    middle, half = (high + low) / 2, (high - low) / 2
    times = tuple(i * HOLD for i in range(len(TOUR)))
    return Reference(times, tuple(middle + half * share for share in TOUR), HOLD * len(TOUR))


def read_reference(text: str, rig: Rig, limits: Limits, unit: str) -> Reference:
    """What `--reference` means: a position, levels with times, or a recording that holds a reference.

    Args:
        text: "60 mm", "0:0 mm, 2:60 mm" (seconds before the colon), or a path.
        rig: names the recording's columns.
        limits: the reference stays within the stroke.
        unit: SI unit of the position.

    Raises:
        InputError: none of these, times that do not increase, or a position beyond the stroke limits.
    """
    where = "--reference"
    if Path(text).suffix and is_file(text):
        record = read_recording(Path(text), rig)
        times = (record.time - record.time[0]).tolist()
        return _within(Reference(tuple(times), tuple(record[REFERENCE].values.tolist())), limits, unit)
    times, values = [], []
    for part in text.split(","):
        before, colon, level = part.rpartition(":")
        try:
            times.append(float(before) if colon else 0.0)
        except ValueError:
            raise InputError(
                f'"{before}" is no time', where=where, expected='"0:0 mm, 2:60 mm", or a file'
            ) from None
        values.append(to_si(level.strip(), unit, where=where))
    if times[0] != 0.0 or not _increasing(times):
        raise InputError(f'"{text}": the times do not increase from 0', where=where)
    return _within(Reference(tuple(times), tuple(values)), limits, unit)


def _increasing(times: Sequence[float]) -> bool:
    return all(a < b for a, b in itertools.pairwise(times))


def _within(reference: Reference, limits: Limits, unit: str) -> Reference:
    low, high = limits.stroke
    for value in (min(reference.values), max(reference.values)):
        if not low <= value <= high:
            raise InputError(
                f"{value:g} {unit} lies beyond the stroke limits",
                where="--reference",
                expected=f"{low:g} to {high:g} {unit}",
            )
    return reference
