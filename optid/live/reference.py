"""The demanded position over time: levels with their start times, a periodic or a recorded profile."""

from __future__ import annotations

import itertools
import math
import re
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from optid.core.paths import is_file
from optid.core.readers import read_recording
from optid.core.units import to_si
from optid.errors import InputError, nearest
from optid.live.settings import Limits
from optid.rigs.channels import REFERENCE
from optid.rigs.rigfile import Rig

HOLD = 2.0  # s at each level of the default tour
TOUR = (0.0, 0.5, -0.5, 0.25, 0.75, -0.25, -0.75)  # levels of it, as shares of the stroke limits' half
WHERE = "--reference"
EXAMPLE = '"60 mm", "0:0 mm, 2:60 mm", "sine 20 mm 0.5 Hz" (square, triangle; about a third value), "tour", or a file'
SINE = 256  # points of a period, straight lines between them: off by 1/13 000 of the amplitude
FASTEST = 1e3  # Hz, and the slowest its reverse
_LEVELS = 1000  # largest number of levels


@dataclass(frozen=True)
class Reference:
    """Values (m) that hold from their times (s, increasing, the first one 0) on; a `period` repeats them.

    Attributes:
        times, values: see above.
        period: s, or ``None``.
        straight: values change along straight lines from one to the next instead of holding.
        start: session time, s, at which its times begin.
    """

    times: tuple[float, ...]
    values: tuple[float, ...]
    period: float | None = None
    straight: bool = False
    start: float = 0.0

    def at(self, time: float) -> float:
        """The demanded position."""
        time -= self.start
        if self.period is not None:
            time %= self.period
        i = max(bisect_right(self.times, time) - 1, 0)
        if not self.straight or i + 1 == len(self.times):
            return self.values[i]
        share = (time - self.times[i]) / (self.times[i + 1] - self.times[i])
        return self.values[i] + share * (self.values[i + 1] - self.values[i])


def tour(limits: Limits) -> Reference:
    """Repeated steps over the middle part of the stroke.

    Raises:
        InputError: the stroke's limits are not known.
    """
    low, high = limits.stroke
    if not high - low < float("inf"):
        raise InputError(
            "the rig file gives no stroke, so there is no tour of it",
            where=WHERE,
            expected='a position, "0:0 mm, 2:60 mm, 5:-40 mm", or a recording with a reference',
        )
    middle, half = (high + low) / 2, (high - low) / 2
    times = tuple(i * HOLD for i in range(len(TOUR)))
    return Reference(times, tuple(middle + half * share for share in TOUR), HOLD * len(TOUR))


def read_reference(text: str, rig: Rig, limits: Limits, unit: str) -> Reference:
    """Parse `--reference`: a profile of `read_profile`, or the path of a recording with a reference.

    Args:
        text: see above.
        rig: names the recording's columns.
        limits: the reference stays within the stroke.
        unit: SI unit of the position.

    Raises:
        InputError: as `read_profile`, or the recording cannot be read.
    """
    if Path(text).suffix and is_file(text):
        record = read_recording(Path(text), rig)
        times = (record.time - record.time[0]).tolist()
        return _within(Reference(tuple(times), tuple(record[REFERENCE].values.tolist())), limits, unit)
    return read_profile(text, limits, unit)


def read_profile(text: str, limits: Limits, unit: str) -> Reference:
    """A position, levels with times, a periodic profile, or the tour of the stroke. Opens no file.

    Args:
        text: "60 mm", "0:0 mm, 2:60 mm" (seconds before the colon), "sine 20 mm 0.5 Hz", "tour".
        limits: the reference stays within the stroke.
        unit: SI unit of the position.

    Raises:
        InputError: none of these, times that do not increase, or a position beyond the stroke limits.
    """
    words = text.split()
    if words == ["tour"]:
        return tour(limits)
    if words and words[0].isalpha():
        return _within(_periodic(words[0], " ".join(words[1:]), limits, unit), limits, unit)
    parts, times, values = text.split(","), [], []
    if len(parts) > _LEVELS:
        raise InputError(f"{len(parts)} levels", where=WHERE, expected=f"at most {_LEVELS}")
    for part in parts:
        before, colon, level = part.rpartition(":")
        try:
            times.append(float(before) if colon else 0.0)
        except ValueError:
            raise InputError(f'"{before}" is not a time', where=WHERE, expected=EXAMPLE) from None
        values.append(to_si(level.strip(), unit, where=WHERE))
    if times[0] != 0.0 or not _increasing(times):
        raise InputError(f'"{text}": the times do not increase from 0', where=WHERE)
    return _within(Reference(tuple(times), tuple(values)), limits, unit)


def _periodic(kind: str, rest: str, limits: Limits, unit: str) -> Reference:
    """A periodic profile of an amplitude and a frequency about a position, by default the stroke's middle."""
    if kind not in WAVES:
        raise InputError(f'"{kind}"', where=WHERE, expected=EXAMPLE, hint=nearest(kind, [*WAVES, "tour"]))
    found = [f"{number} {of}".strip() for number, of in _VALUE.findall(rest)]
    if len(found) not in (2, 3) or _VALUE.sub("", rest).strip():
        raise InputError(f'"{kind} {rest}"', where=WHERE, expected=EXAMPLE)
    size = to_si(found[0], unit, where=WHERE, field=kind)
    rate = to_si(found[1], "Hz", where=WHERE, field=kind)
    if not 1 / FASTEST <= rate <= FASTEST:
        expected = f"{1 / FASTEST:g} to {FASTEST:g} Hz"
        raise InputError(f"{rate:g} Hz", where=WHERE, field=kind, expected=expected)
    low, high = limits.stroke
    middle = (low + high) / 2 if math.isfinite(high - low) else 0.0
    about = to_si(found[2], unit, where=WHERE, field=kind) if found[2:] else middle
    shares, levels, straight = WAVES[kind]
    times = tuple(share / rate for share in shares)
    return Reference(times, tuple(about + size * level for level in levels), 1 / rate, straight)


def _sine() -> tuple[tuple[float, ...], tuple[float, ...], bool]:
    shares = tuple(i / SINE for i in range(SINE + 1))
    return shares, tuple(math.sin(2 * math.pi * share) for share in shares), True


# Profile -> shares of its period, levels there as shares of the amplitude, and whether straight lines join them.
WAVES = {
    "sine": _sine(),
    "square": ((0.0, 0.5), (1.0, -1.0), False),
    "triangle": ((0.0, 0.25, 0.75, 1.0), (0.0, 1.0, -1.0, 0.0), True),
}
_VALUE = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\s\d+-][^\s]*)?")


def _increasing(times: Sequence[float]) -> bool:
    return all(a < b for a, b in itertools.pairwise(times))


def _within(reference: Reference, limits: Limits, unit: str) -> Reference:
    low, high = limits.stroke
    for value in (min(reference.values), max(reference.values)):
        if not low <= value <= high:
            raise InputError(
                f"{value:g} {unit} lies beyond the stroke limits",
                where=WHERE,
                expected=f"{low:g} to {high:g} {unit}",
            )
    return reference
