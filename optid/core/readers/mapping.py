"""From columns to channels: the rig file's map applied to a table, with every value checked on the way."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from optid.core.readers.clocks import Timed, aligned, contradicted, refuse_bursts, unwrapped
from optid.core.readers.columns import numbers_of_column, refuse_disorder, times_of, unit_notes
from optid.core.readers.formats import read_table
from optid.core.readers.own_rate import held_between
from optid.core.readers.repair import repaired
from optid.core.readers.table import Clock, Column, Table, offered
from optid.core.recording import Array, Channel, ChannelMap, Provenance, Recording, midpoints, sealed
from optid.errors import RecordingError

_MANY = 20  # rows that show that the first one is not data
_OTHERS = 0.5  # of the rows: where fewer hold a mapped value, the rest belong to other channels


class Mapped(Protocol):
    """What a recording needs to know of a rig: role -> how its column is read. "time" must be among them."""

    @property
    def channels(self) -> Mapping[str, ChannelMap]:
        """Role -> how its column is read."""
        ...


def read_recording(path: str | Path, rig: Mapped) -> Recording:
    """Read a recording file into the channels a rig maps, in SI units.

    Only the mapped columns are read; all others may contain anything.

    Parameters
    ----------
    path : str | Path
        CSV and other text tables, Parquet, .mat, HDF5 or TDMS, possibly gzipped.
    rig : Mapped
        anything with `channels`; its time may be a column or a rate (the first sample is then at 0 s).

    Returns
    -------
    Recording
        The recording, named by its file name. Positions are recorded minus the rig's offset; a command with a
        full scale is divided by it. Repairs are listed in `provenance`.

    Raises
    ------
    RecordingError
        the file cannot be read; a column is missing, empty, or holds text or an infinite
        value; the times do not increase, or contradict the rate that the rig states.
    """
    path = Path(path)
    table, digest = read_table(path, wanted_columns(rig))
    held = [table]
    del table  # nothing here keeps a long file's columns in memory
    return recording_of(held.pop(), digest, rig, path)


def wanted_columns(rig: Mapped) -> list[str]:
    """Names of the columns that a rig maps."""
    maps = rig.channels
    wanted = [maps["time"].column, *(channel.column for role, channel in maps.items() if role != "time")]
    return [column for column in wanted if column]


def recording_of(table: Table, digest: str | None, rig: Mapped, path: Path) -> Recording:
    """The recording that a table holds, as `read_recording`.

    Parameters
    ----------
    table : Table
        the columns that the rig maps.
    digest : str | None
        of the file; without one the recording has no provenance.
    rig : Mapped
        anything with `channels`.
    path : Path
        of the file, or the name of what is in memory.
    """
    maps = rig.channels
    _check_columns(table, maps, path)
    found = _on_one_clock(table, maps, path)
    held = {role: channel.held for role, channel in maps.items()}
    values, between = held_between(found.time, found.values, held)
    time, notes = sealed(found.time), (*table.notes, *found.notes, *between)
    rows, reader = max(len(column.values) for column in table.columns.values()), table.reader
    del table, found  # a long file's columns are freed one by one
    values, repairs = repaired(values, held)
    channels = {role: _channel(values.pop(role), maps[role]) for role in tuple(values)}
    if digest is None:
        return Recording(path.name, time, channels)
    columns = {role: channel.column for role, channel in maps.items()}
    return Recording(
        path.name, time, channels, Provenance(path, digest, reader, columns, rows, notes, repairs)
    )


@dataclass(frozen=True, eq=False)
class _Rows:
    time: Array
    values: dict[str, Array]
    notes: tuple[str, ...]


def _check_columns(table: Table, maps: Mapping[str, ChannelMap], path: Path) -> None:
    for role, channel in maps.items():
        name = channel.column
        if not name or name in table.columns:
            continue
        why = table.left_out.get(name)
        message = f'column "{name}" {why}' if why else f'no column "{name}"'
        if table.about:
            message = (
                f"this is {table.about}: {message}"
                if table.about.startswith(("a ", "an "))
                else (f"{message} ({table.about})")
            )
        hint = None if why else offered(name, table.names)
        if role == "time" and not why:
            rate = _rate_of(table)
            hint = (
                f'the file has its own clock: give the rate: rate = "{rate:.6g} Hz" instead of a time column'
                if rate
                else hint
            )
        raise RecordingError(message, where=path, field=role, hint=hint)


def _rate_of(table: Table) -> float | None:
    """Of the clock that the file gives its columns."""
    clocks = [c.clock for c in table.columns.values() if c.clock is not None and len(c.clock.seconds) > 1]
    return 1 / float(np.median(np.diff(clocks[0].seconds))) if clocks else None


def _on_one_clock(table: Table, maps: Mapping[str, ChannelMap], path: Path) -> _Rows:
    """The channels over one time axis, by the rig's time column or rate, or by the file's own clocks."""
    values = {
        role: numbers_of_column(table, channel, path) for role, channel in maps.items() if role != "time"
    }
    columns = {role: table.columns[maps[role].column] for role in values}
    notes = tuple(note for role in values for note in unit_notes(role, columns[role].unit, maps[role]))
    clocks = {
        role: _clock(column, maps["time"]) for role, column in columns.items() if column.clock is not None
    }
    stated = maps["time"].rate
    if clocks and stated is not None:
        _refuse_contradiction(stated, clocks, path)
    if len(clocks) == len(values) and _differ(clocks, values):
        signals = {role: Timed(values[role], clocks[role], maps[role].held) for role in values}
        together = aligned(signals, path)
        return _Rows(together.time, dict(together.values), notes + together.notes)
    return _in_rows(table, maps, values, notes, path)


def _clock(column: Column, time: ChannelMap) -> Clock:
    assert column.clock is not None
    clock = column.clock
    return (
        replace(clock, seconds=clock.seconds * time.factor, in_rig_unit=False) if clock.in_rig_unit else clock
    )


def _differ(clocks: Mapping[str, Clock], values: Mapping[str, Array]) -> bool:
    """The clocks begin or run differently, or the channels have other lengths."""
    first, *others = clocks.values()
    if len({len(one) for one in values.values()}) > 1:
        return True
    step = float(np.median(np.diff(first.seconds))) if len(first.seconds) > 1 else 1.0
    return any(
        abs((c.origin - first.origin) * 1e-9 + c.seconds[0] - first.seconds[0]) > 1e-3 * step
        or not np.allclose(
            c.seconds - c.seconds[0], first.seconds - first.seconds[0], atol=1e-3 * step, rtol=0
        )
        for c in others
    )


def _refuse_contradiction(stated: float, clocks: Mapping[str, Clock], path: Path) -> None:
    rates = {role: contradicted(stated, clock) for role, clock in clocks.items()}
    if all(rate is not None for rate in rates.values()):
        role, rate = next((role, rate) for role, rate in rates.items() if rate is not None)
        raise RecordingError(
            f"according to the file's clock {role} has {rate:.6g} samples a second, the rig file states "
            f"{stated:.6g} Hz",
            where=path,
            field="rate",
            expected=f'rate = "{rate:.6g} Hz"',
            hint="or save the file with the right clock",
        )


def _in_rows(
    table: Table, maps: Mapping[str, ChannelMap], values: dict[str, Array], notes: tuple[str, ...], path: Path
) -> _Rows:
    """Channels that share the rows of a table."""
    time = maps["time"]
    raw = None if time.rate is not None else times_of(table, time, path)
    lengths = {maps[role].column: len(one) for role, one in values.items()}
    rows = len(raw[0]) if raw is not None else max(lengths.values())
    for role, one in values.items():
        if len(one) != rows:
            other = f'"{time.column}"' if raw is not None else "another channel"
            raise RecordingError(
                f'column "{maps[role].column}" has {len(one)} values where {other} has {rows}',
                where=path,
                field=role,
                expected="channels of equal length, or a time column for each",
            )
    if rows < 2:
        raise RecordingError("fewer than two rows of data", where=path)
    if raw is None:
        assert time.rate is not None
        last = max(int(np.flatnonzero(np.isfinite(one))[-1]) for one in values.values()) + 1
        trimmed = {role: one[:last] for role, one in values.items()}
        return _Rows(np.arange(last) / time.rate, trimmed, notes)
    return _by_time(raw, values, table, time, notes, path)


def _by_time(
    raw: tuple[Array, float, float, tuple[str, ...]],
    values: dict[str, Array],
    table: Table,
    time: ChannelMap,
    notes: tuple[str, ...],
    path: Path,
) -> _Rows:
    """Rows in their order, without those that hold no value, by times that increase."""
    times, factor, zero, more = raw
    notes += more
    field = f'column "{time.column}"'
    keep = np.zeros(len(times), dtype=bool)
    for one in values.values():
        keep |= np.isfinite(one)
    if keep.mean() > _OTHERS:  # else the other rows are those of another logger, joined over time
        keep |= np.isfinite(times)
    if not keep.all():
        notes += (f"{int((~keep).sum())} rows without any value are skipped",)
        values = {role: one[keep] for role, one in values.items()}
        times = times[keep]
    numbers_of = np.flatnonzero(keep) if not keep.all() else None

    def place(row: int) -> str:
        return table.place(int(row if numbers_of is None else numbers_of[row]))

    if len(times) < 2:
        raise RecordingError("fewer than two rows of data", where=path)
    missing = np.isnan(times)
    if missing.any():
        raise RecordingError(
            f"{place(int(missing.argmax()))} has no time",
            where=path,
            field=field,
            expected="a time in every row",
        )
    if table.reader == "csv" and _begins_with_facts(times):
        notes += (
            f"{place(0)} comes before the data, and its time does not fit them (scales or channel numbers?)",
        )
        values, times = {role: one[1:] for role, one in values.items()}, times[1:]
        numbers_of = (np.flatnonzero(keep) if numbers_of is None else numbers_of)[1:]
    times, said = unwrapped(times, time.unit if factor != 1.0 or not zero else "s", place)
    refuse_disorder(times, place, field, path)
    seconds = factor * times
    refuse_bursts(seconds, field, path)
    return _Rows(seconds, values, notes + said)


def _begins_with_facts(times: Array) -> bool:
    """The first of many rows is the only one out of order, and lies within the times of the others."""
    return len(times) > _MANY and times[1] <= times[0] < times[-1] and bool((np.diff(times[1:]) > 0).all())


def _channel(values: Array, channel: ChannelMap) -> Channel:
    values = channel.factor * values
    if channel.shift:
        values += channel.shift
    return Channel(
        role=channel.role,
        column=channel.column,
        unit=channel.model_unit,
        values=sealed(midpoints(values) if channel.linear else values),
        sd=channel.sd,
        full_scale=channel.full_scale,
        per_unit=channel.per_unit,
        recorded_unit=channel.recorded_unit,
        held=channel.held,
    )
