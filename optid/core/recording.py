"""A recording: measured signals in SI units, with the provenance of every number."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from optid.core.channel import Array, Channel, ChannelMap, Provenance, Repair
from optid.errors import RecordingError, nearest

if TYPE_CHECKING:
    import pandas as pd

    from optid.core.readers.mapping import Mapped

__all__ = [
    "GAP",
    "LONG_GAP",
    "Array",
    "Channel",
    "ChannelMap",
    "Interval",
    "Provenance",
    "Recording",
    "Repair",
    "frozen",
    "held",
    "midpoints",
    "sealed",
]

Interval = tuple[float, float]

GAP = 1.5  # median sampling intervals: beyond, at least one sample is missing from the table
LONG_GAP = 10.0  # median sampling intervals: for longer, a held command is no longer trusted


@dataclass(frozen=True, eq=False)
class Recording:
    """Channels over one time axis.

    Attributes
    ----------
    name : str
        the file's name, as findings refer to it.
    time : Array
        s, shape (samples,), strictly increasing, read-only.
    channels : Mapping[str, Channel]
        role -> channel, every one with `len(time)` values.
    provenance : Provenance | None
        the file behind it; ``None`` for a recording made in memory.

    Raises
    ------
    RecordingError
        fewer than two samples, times that do not increase, or lengths that differ.
    """

    name: str
    time: Array
    channels: Mapping[str, Channel]
    provenance: Provenance | None = None

    def __post_init__(self) -> None:
        time = frozen(self.time)
        object.__setattr__(self, "time", time)
        if time.ndim != 1 or len(time) < 2:
            raise RecordingError(f"{time.size} samples", where=self.name, expected="at least two")
        if not (np.isfinite(time).all() and (np.diff(time) > 0).all()):
            raise RecordingError("the times are not strictly increasing", where=self.name, field="time")
        channels = {}
        for role, channel in self.channels.items():
            values = frozen(channel.values)
            if values.shape != time.shape:
                raise RecordingError(
                    f"{values.size} values", where=self.name, field=role, expected=f"{time.size}"
                )
            channels[role] = dataclasses.replace(channel, values=values)
        object.__setattr__(self, "channels", channels)

    @classmethod
    def from_frame(cls, frame: pd.DataFrame, rig: Mapped, name: str = "frame") -> Recording:
        """A recording from a table in memory, one row per sample.

        Parameters
        ----------
        frame : pd.DataFrame
            columns as the rig file maps them, by its names or by role ("time", "command", ...), in its units; other
            columns are ignored. NaN is a missing sample.
        rig : Mapped
            as read with `read_rig`.
        name : str
            name of the recording, as findings refer to it.

        Raises
        ------
        RecordingError
            a column is missing, empty, or holds text or an infinite value; times do not increase.
        """
        from optid.core.readers.memory import recording_from_frame

        return recording_from_frame(frame, rig, name)

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, ArrayLike], rig: Mapped, name: str = "arrays") -> Recording:
        """A recording from arrays in memory, all of shape (samples,), by column or role as in `from_frame`.

        Parameters
        ----------
        arrays : Mapping[str, ArrayLike]
            column or role -> values, (samples,) each.
        rig : Mapped
            whose channels say which column is what.
        name : str
            of the recording.

        Raises
        ------
        RecordingError
            as `from_frame`; arrays of other shapes.
        """
        from optid.core.readers.memory import recording_from_arrays

        return recording_from_arrays(arrays, rig, name)

    def __len__(self) -> int:
        return len(self.time)

    def __contains__(self, role: object) -> bool:
        return role in self.channels

    def __getitem__(self, role: str) -> Channel:
        if role not in self.channels:
            raise RecordingError(f'no channel "{role}"', where=self.name, hint=nearest(role, self.channels))
        return self.channels[role]

    @cached_property
    def interval(self) -> float:
        """Median time between samples, s, to ten digits: the rest is rounding of the times themselves."""
        return float(f"{np.median(np.diff(self.time)):.10g}")

    @property
    def rate(self) -> float:
        """Median sampling rate, Hz."""
        return 1.0 / self.interval

    @property
    def duration(self) -> float:
        """Time from the first to the last sample, s."""
        return float(self.time[-1] - self.time[0])

    @property
    def missing(self) -> dict[str, int]:
        """Role -> number of missing samples, for every channel that has some."""
        return {role: channel.missing for role, channel in self.channels.items() if channel.missing}

    def gaps(self, longer_than: float = GAP) -> tuple[Interval, ...]:
        """Times (s) of neighbouring samples that are further apart than this many median intervals.

        Parameters
        ----------
        longer_than : float
            median intervals.

        Returns
        -------
        tuple[Interval, ...]
            times (s) of the samples before and after each gap.
        """
        after = np.flatnonzero(np.diff(self.time) > longer_than * self.interval)
        return tuple((float(self.time[i]), float(self.time[i + 1])) for i in after)

    def slice(self, start: float = -math.inf, stop: float = math.inf) -> Recording:
        """The samples with ``start <= time < stop``, both in seconds of this recording's own clock.

        Parameters
        ----------
        start : float
            s; the first sample at or after it.
        stop : float
            s; the last sample before it.

        Returns
        -------
        Recording
            that part, under the same name.

        Raises
        ------
        RecordingError
            fewer than two samples lie there.
        """
        first, last = np.searchsorted(self.time, (start, stop))
        if last - first < 2:
            span = f"{self.time[0]:g} to {self.time[-1]:g} s"
            raise RecordingError(
                f"{max(last - first, 0)} samples from {start:g} to {stop:g} s",
                where=self.name,
                expected=f"at least two; the recording runs from {span}",
            )
        return self.part(int(first), int(last))

    def segments(self, longer_than: float = LONG_GAP) -> tuple[Recording, ...]:
        """Stretches between gaps longer than this many median intervals, so that no gap is simulated across.

        A stretch in which a held channel (a command) is missing for so long is a gap, too. A shorter gap stays inside
        a stretch: the command before it is assumed to hold. Stretches of a single sample contain no motion and are
        left out.

        Parameters
        ----------
        longer_than : float
            median intervals; shorter gaps stay inside a stretch.

        Returns
        -------
        tuple[Recording, ...]
            the stretches in their order.
        """
        rows = np.flatnonzero(self.commanded(longer_than))
        if not len(rows):
            return ()
        apart = (np.diff(self.time[rows]) > longer_than * self.interval) | (np.diff(rows) > longer_than)
        edges = [0, *map(int, np.flatnonzero(apart) + 1), len(rows)]
        return tuple(self.taken(rows[a:b]) for a, b in itertools.pairwise(edges) if b - a > 1)

    def commanded(self, longer_than: float = LONG_GAP) -> NDArray[np.bool_]:
        """Samples at which every held channel is known, or missing for no longer than this many median intervals.

        Those before the first known one count as missing for long.

        Parameters
        ----------
        longer_than : float
            median intervals; a command that is missing for no longer is assumed to hold.

        Returns
        -------
        NDArray[bool]
            (samples,), true where every held channel is known.
        """
        known = np.ones(len(self), dtype=bool)
        for channel in self.channels.values():
            if channel.held and channel.missing:
                absent = np.isnan(channel.values)
                edges = np.flatnonzero(np.diff(np.concatenate(([False], absent, [False])).astype(np.int8)))
                for a, b in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
                    span = self.time[b - 1] - self.time[a] + self.interval
                    known[a:b] &= a > 0 and span <= longer_than * self.interval
        return known

    def to_frame(self) -> pd.DataFrame:
        """Columns "time" and one for every role, in SI units, one row per sample.

        Returns
        -------
        pd.DataFrame
            time (s) and a column per role, SI, one row per sample.
        """
        import pandas as pd

        return pd.DataFrame({"time": self.time, **{r: c.values for r, c in self.channels.items()}})

    def part(self, first: int, last: int) -> Recording:
        """Samples `first` to `last` - 1; nothing is copied.

        Parameters
        ----------
        first : int
            the first sample.
        last : int
            one past the last.

        Returns
        -------
        Recording
            those samples.
        """
        channels = {
            role: dataclasses.replace(channel, values=channel.values[first:last])
            for role, channel in self.channels.items()
        }
        return dataclasses.replace(self, time=self.time[first:last], channels=channels)

    def taken(self, rows: NDArray[np.int64]) -> Recording:
        """The given samples, in their order; samples left out between them become a gap.

        Parameters
        ----------
        rows : NDArray[np.int64]
            samples to keep, (n,).

        Returns
        -------
        Recording
            those samples alone.
        """
        channels = {
            role: dataclasses.replace(channel, values=channel.values[rows])
            for role, channel in self.channels.items()
        }
        return dataclasses.replace(self, time=self.time[rows], channels=channels)


def frozen(values: Array) -> Array:
    """A read-only float64 array of the same values; copies only what is writable or of another type."""
    array = np.asarray(values, dtype=np.float64)
    if array.flags.writeable:
        array = array.copy()
        array.flags.writeable = False
    return array


def sealed(values: Array) -> Array:
    """The same array, made read-only: for one without other references."""
    values = np.asarray(values, dtype=np.float64)
    values.flags.writeable = False
    return values


def midpoints(values: Array) -> Array:
    """The mean, until the next sample, of an input that is interpolated linearly.

    Held from sample to sample, the mean acts on a slower plant like the straight line: both have the same impulse, and
    their difference is of second order in the sampling time. A held value would be half a sample late.
    """
    return np.append(
        np.where(np.isfinite(values[1:]), (values[:-1] + values[1:]) / 2, values[:-1]), values[-1:]
    )


def held(values: Array) -> Array:
    """A command with its missing samples filled by the value held before them (or the first one known)."""
    known = np.isfinite(values)
    if known.all() or not known.any():
        return np.where(known, values, 0.0)
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), 0))
    filled = values[last]
    return np.where(np.isfinite(filled), filled, values[np.argmax(known)])
