"""From columns to channels: the rig file's map applied to a table, with every value checked on the way."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from optid.core.document import HUGE
from optid.core.readers.cells import Unreadable, is_missing, is_stamp, numbers
from optid.core.readers.clocks import Timed, aligned, contradicted, refuse_bursts, unwrapped
from optid.core.readers.formats import read_table
from optid.core.readers.limits import shown
from optid.core.readers.repair import held_between, repaired
from optid.core.readers.stamps import MISSING, seconds_of
from optid.core.readers.table import Clock, Column, Raw, Table, offered
from optid.core.recording import Array, Channel, ChannelMap, Provenance, Recording, frozen, midpoints
from optid.errors import RecordingError

_EPOCH = 1e7  # s: later times count from 1970 or a boot long ago, and are told from their first sample on
_OTHERS = 0.5  # of the rows: where fewer hold a mapped value, the rest belong to other channels
_EXACT = 2**53  # integers beyond lose digits as float64


class Mapped(Protocol):
    """What a recording needs to know of a rig: role -> how its column is read. "time" must be among them."""

    @property
    def channels(self) -> Mapping[str, ChannelMap]:
        """Role -> how its column is read."""
        ...


def read_recording(path: str | Path, rig: Mapped) -> Recording:
    """Read a recording file into the channels a rig maps, in SI units.

    Only the mapped columns are read; whatever else a file holds may be anything.

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
        full scale is divided by it. What was put right is told in `provenance`.

    Raises
    ------
    RecordingError
        the file cannot be read; a column is missing, empty, or holds text or an infinite
        value; the times do not increase, or contradict the rate that the rig states.
    """
    path = Path(path)
    table, digest = read_table(path, wanted_columns(rig))
    return recording_of(table, rig, path, digest)


def wanted_columns(rig: Mapped) -> list[str]:
    """Names of the columns that a rig maps."""
    maps = rig.channels
    wanted = [maps["time"].column, *(channel.column for role, channel in maps.items() if role != "time")]
    return [column for column in wanted if column]


def recording_of(table: Table, rig: Mapped, path: Path, digest: str | None = None) -> Recording:
    """The recording that a table holds, as `read_recording`.

    Parameters
    ----------
    table : Table
        the columns that the rig maps.
    rig : Mapped
        anything with `channels`.
    path : Path
        of the file, or the name of what is in memory.
    digest : str | None
        of the file; without one the recording has no provenance.
    """
    maps = rig.channels
    _check_columns(table, maps, path)
    found = _on_one_clock(table, maps, path)
    held = {role: channel.held for role, channel in maps.items()}
    values, between = held_between(found.time, found.values, held)
    values, repairs = repaired(values, held)
    channels = {role: _channel(values[role], maps[role]) for role in values}
    if digest is None:
        return Recording(path.name, found.time, channels)
    columns = {role: channel.column for role, channel in maps.items()}
    notes = (*table.notes, *found.notes, *between)
    source = Provenance(path, digest, table.reader, columns, len(found.time), notes, repairs)
    return Recording(path.name, found.time, channels, source)


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
                f'the file has its own clock: state rate = "{rate:.6g} Hz" instead of a time column'
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
    values = {role: _numbers(table, channel, path) for role, channel in maps.items() if role != "time"}
    columns = {role: table.columns[maps[role].column] for role in values}
    notes = tuple(note for role in values for note in _unit_notes(role, columns[role].unit, maps[role]))
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
            f"by the file's own clock {role} has {rate:.6g} samples a second, the rig file states {stated:.6g} Hz",
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
    raw = None if time.rate is not None else _time_raw(table, time, path)
    lengths = {maps[role].column: len(one) for role, one in values.items()}
    rows = len(raw[0]) if raw is not None else max(lengths.values())
    for role, one in values.items():
        if len(one) != rows:
            other = f'"{time.column}"' if raw is not None else "another channel"
            raise RecordingError(
                f'column "{maps[role].column}" has {len(one)} values where {other} has {rows}',
                where=path,
                field=role,
                expected="channels of one length, or a clock for each",
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
        notes += (f"{int((~keep).sum())} rows without any value are left out",)
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
    times, said = unwrapped(times, time.unit if factor != 1.0 or not zero else "s", place)
    _refuse_disorder(times, place, field, path)
    seconds = factor * times
    refuse_bursts(seconds, field, path)
    return _Rows(seconds, values, notes + said)


def _refuse_disorder(times: Array, place: Callable[[int], str], field: str, path: Path) -> None:
    steps = np.diff(times)
    stuck = steps <= 0
    if not stuck.any():
        return
    row = int(stuck.argmax()) + 1
    before, here = times[row - 1], times[row]
    what = f"repeats {here:.10g}" if here == before else f"goes back from {before:.10g} to {here:.10g}"
    hint = (
        'if the times are rounded, state rate = "... Hz" instead'
        if here == before
        else "if two recordings follow each other, or a clock began anew, cut the file there"
    )
    raise RecordingError(
        f"{place(row)} {what}", where=path, field=field, expected="times that increase", hint=hint
    )


def _time_raw(table: Table, time: ChannelMap, path: Path) -> tuple[Array, float, float, tuple[str, ...]]:
    """The time column as recorded: values, factor to seconds, what was subtracted, notes."""
    column = table.columns[time.column]
    values = column.values
    notes = tuple(_unit_notes("time", column.unit, time))
    if values.dtype.kind in "mMO" and len(values):
        stamped = _stamped(values, table, time, path)
        if stamped is not None:
            return (*stamped, notes)
    if values.dtype.kind in "iu" and len(values):
        first = int(values[0])
        if abs(first) * time.factor > _EPOCH or abs(first) > _EXACT:
            # Integers are subtracted as such: as floats the stamps of today's nanoseconds lose their last digits.
            begun = (values.astype(np.int64) - np.int64(first)).astype(np.float64)
            return begun, time.factor, float(first), (*notes, _since(first * time.factor))
    raw = _numbers(table, time, path)
    known = raw[np.isfinite(raw)]
    if len(known) and abs(float(known[0])) * time.factor > _EPOCH:
        return raw - known[0], time.factor, float(known[0]), (*notes, _since(float(known[0]) * time.factor))
    return raw, time.factor, 0.0, notes


def _since(seconds: float) -> str:
    return f"times are told from the first sample on, which the file has at {seconds:.9g} s"


def _stamped(values: Raw, table: Table, time: ChannelMap, path: Path) -> tuple[Array, float, float] | None:
    """Stamps and durations, which have one meaning in seconds whatever unit the rig file states."""
    if values.dtype.kind == "O":
        texts = [str(v).strip() for v in values[:50] if isinstance(v, str) and not is_missing(v.strip())]
        if not texts or not all(map(is_stamp, texts)):
            return None
        try:
            ns, dated = seconds_of(values)
        except Unreadable as error:
            raise RecordingError(
                f'{table.place(error.row)} holds "{shown(error.found)}"',
                where=path,
                field=f'column "{time.column}"',
                expected="a time such as 10:00:00.001 or a number",
            ) from None
    else:
        ns, dated = values.astype(f"{values.dtype.kind}8[ns]").astype(np.int64), values.dtype.kind == "M"
    known = ns != MISSING
    if not known.any():
        return None
    first = int(ns[known][0]) if dated else 0
    return np.where(known, (ns - first) * 1e-9, np.nan), 1.0, float(first)


def _unit_notes(role: str, unit: str, channel: ChannelMap) -> list[str]:
    """A word where the file states another unit than the rig file, of the same quantity but of another size."""
    from optid.core.units import conversion
    from optid.errors import InputError

    if not unit or unit == channel.unit or not unit.isprintable():
        return []
    try:
        theirs = conversion(unit, channel.recorded_unit).factor
        ours = conversion(channel.unit, channel.recorded_unit).factor
    except (InputError, ValueError, ArithmeticError):
        return []
    if abs(theirs / ours - 1) < 1e-6:
        return []
    return [
        f"the file says {shown(unit)} for {role}, the rig file {channel.unit}: the rig file's is used; if the file is "
        f"right, values are {ours / theirs:.4g} times too large"
    ]


def _numbers(table: Table, channel: ChannelMap, path: Path) -> Array:
    """A column as float64, NaN where a sample is missing."""
    values = table.columns[channel.column].values
    field = f'column "{channel.column}"'
    if values.dtype.kind in "cmM":
        found = {"c": "complex numbers", "m": "durations", "M": "dates"}[values.dtype.kind]
        raise RecordingError(found, where=path, field=field, expected=f"numbers in {channel.unit}")
    if values.dtype.kind not in "iufb":
        try:
            values = numbers(values.astype(object), False)
        except Unreadable as error:
            raise RecordingError(
                f'{table.place(error.row)} holds "{shown(error.found)}"',
                where=path,
                field=field,
                expected=f"a number in {channel.unit}",
            ) from None
    values = values.astype(np.float64, copy=False)
    infinite = np.isinf(values)
    if infinite.any():
        row = int(infinite.argmax())
        raise RecordingError(
            f"{table.place(row)} is infinite", where=path, field=field, expected="a finite number or nothing"
        )
    huge = np.abs(values) > HUGE  # a few readings of a sensor are put right later; a clock has none
    if huge.any() and (channel.role == "time" or 2 * huge.sum() > np.isfinite(values).sum()):
        row = int(huge.argmax())
        raise RecordingError(
            f"{table.place(row)} holds {values[row]:.4g}",
            where=path,
            field=field,
            expected=f"numbers in {channel.unit} that something can have",
        )
    if np.isnan(values).all():
        raise RecordingError(
            "no row has a value", where=path, field=field, expected=f"numbers in {channel.unit}"
        )
    return values


def _channel(values: Array, channel: ChannelMap) -> Channel:
    values = channel.factor * values + channel.shift
    return Channel(
        role=channel.role,
        column=channel.column,
        unit=channel.model_unit,
        values=frozen(midpoints(values) if channel.linear else values),
        sd=channel.sd,
        full_scale=channel.full_scale,
        per_unit=channel.per_unit,
        recorded_unit=channel.recorded_unit,
        held=channel.held,
    )
