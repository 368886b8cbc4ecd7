"""From columns to channels: the rig file's map applied to a table, with every value checked on the way."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

import numpy as np

from optid.core.readers.table import Table, read_table
from optid.core.recording import Array, Channel, ChannelMap, Provenance, Recording, frozen
from optid.errors import RecordingError, nearest


class Mapped(Protocol):
    """What a recording needs to know of a rig: role -> how its column is read. "time" must be among them."""

    @property
    def channels(self) -> Mapping[str, ChannelMap]:
        """Role -> how its column is read."""
        ...


def read_recording(path: str | Path, rig: Mapped) -> Recording:
    """Read a recording file into the channels a rig maps, in SI units.

    Args:
        path: CSV, Parquet, .mat or TDMS, possibly gzipped.
        rig: anything with `channels`; its time may be a column or a rate (the first sample is then at 0 s).

    Returns:
        The recording, named by its file name. Positions are recorded minus the rig's offset; a command with a
        full scale is divided by it.

    Raises:
        RecordingError: the file cannot be read; a column is missing, empty, or holds text or an infinite
            value; the times do not increase.
    """
    path = Path(path)
    table, digest = read_table(path)
    return recording_of(table, rig, path, digest)


def recording_of(table: Table, rig: Mapped, path: Path, digest: str | None = None) -> Recording:
    """The recording that a table holds, as `read_recording`.

    Args:
        table: raw columns.
        rig: anything with `channels`.
        path: of the file, or the name of what is in memory.
        digest: of the file; without one the recording has no provenance.
    """
    maps = rig.channels
    _check_columns(table, maps, path)
    time = _time(table, maps["time"], path)
    channels = {role: _channel(table, channel, path) for role, channel in maps.items() if role != "time"}
    if digest is None:
        return Recording(path.name, time, channels)
    columns = {role: channel.column for role, channel in maps.items()}
    source = Provenance(path, digest, table.reader, columns, len(table.frame), table.notes)
    return Recording(path.name, time, channels, source)


def _check_columns(table: Table, maps: Mapping[str, ChannelMap], path: Path) -> None:
    names = list(table.frame.columns)
    for role, channel in maps.items():
        if not channel.column or channel.column in names:
            continue
        why = table.left_out.get(channel.column)
        message = f'column "{channel.column}" {why}' if why else f'no column "{channel.column}"'
        raise RecordingError(
            message, where=path, field=role, hint=None if why else nearest(channel.column, names)
        )
    if len(table.frame) < 2:
        raise RecordingError("fewer than two rows of data", where=path)


def _numbers(table: Table, channel: ChannelMap, path: Path) -> Array:
    """A column as float64, NaN where a sample is missing."""
    import pandas as pd

    series = table.frame[channel.column]
    field = f'column "{channel.column}"'
    if series.dtype.kind in "cmM":
        found = "complex numbers" if series.dtype.kind == "c" else "dates"
        raise RecordingError(f"{found}", where=path, field=field, expected=f"numbers in {channel.unit}")
    numeric = pd.to_numeric(series, errors="coerce")
    text = (numeric.isna() & series.notna()).to_numpy()
    if text.any():
        row = int(text.argmax())
        found = str(series.iloc[row])[:40]
        raise RecordingError(
            f'{table.place(row)} holds "{found}"',
            where=path,
            field=field,
            expected=f"a number in {channel.unit}",
        )
    values = numeric.to_numpy(dtype=np.float64, na_value=np.nan)
    infinite = np.isinf(values)
    if infinite.any():
        row = int(infinite.argmax())
        raise RecordingError(
            f"{table.place(row)} is infinite", where=path, field=field, expected="a finite number or nothing"
        )
    if np.isnan(values).all():
        raise RecordingError(
            "no row has a value", where=path, field=field, expected=f"numbers in {channel.unit}"
        )
    return values


def _time(table: Table, channel: ChannelMap, path: Path) -> Array:
    if channel.rate is not None:
        return np.arange(len(table.frame)) / channel.rate
    raw = _numbers(table, channel, path)
    field = f'column "{channel.column}"'
    missing = np.isnan(raw)
    if missing.any():
        row = int(missing.argmax())
        raise RecordingError(
            f"{table.place(row)} has no time", where=path, field=field, expected="a time in every row"
        )
    stuck = np.diff(raw) <= 0
    if stuck.any():
        row = int(stuck.argmax()) + 1
        before, here = raw[row - 1], raw[row]
        what = f"repeats {here:.10g}" if here == before else f"goes back from {before:.10g} to {here:.10g}"
        hint = 'if the times are rounded, state rate = "... Hz" instead' if here == before else None
        raise RecordingError(
            f"{table.place(row)} {what}", where=path, field=field, expected="times that increase", hint=hint
        )
    return channel.factor * raw + channel.shift


def _channel(table: Table, channel: ChannelMap, path: Path) -> Channel:
    values = channel.factor * _numbers(table, channel, path) + channel.shift
    return Channel(
        role=channel.role,
        column=channel.column,
        unit=channel.model_unit,
        values=frozen(values),
        sd=channel.sd,
        full_scale=channel.full_scale,
        per_unit=channel.per_unit,
        recorded_unit=channel.recorded_unit,
    )
