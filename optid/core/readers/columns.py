"""One mapped column as numbers: values with every cell checked, times as recorded, and the unit the file states."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from optid.core.document import HUGE
from optid.core.readers.cells import Unreadable, is_missing, is_stamp, numbers
from optid.core.readers.limits import shown
from optid.core.readers.stamps import MISSING, seconds_of
from optid.core.readers.table import Raw, Table
from optid.core.recording import Array, ChannelMap
from optid.errors import RecordingError

_EPOCH = 1e7  # s: later times count from 1970 or from a boot, and are shifted to start at the first sample
_EXACT = 2**53  # larger integers lose digits as float64


def refuse_disorder(times: Array, place: Callable[[int], str], field: str, path: Path) -> None:
    """Times must increase.

    Raises:
        RecordingError: names the first row that repeats or goes back.
    """
    steps = np.diff(times)
    stuck = steps <= 0
    if not stuck.any():
        return
    row = int(stuck.argmax()) + 1
    before, here = times[row - 1], times[row]
    what = f"repeats {here:.10g}" if here == before else f"goes back from {before:.10g} to {here:.10g}"
    hint = (
        'if the times are rounded, give the rate: rate = "... Hz" instead'
        if here == before
        else "if two recordings follow each other, or a clock restarted, cut the file there"
    )
    raise RecordingError(
        f"{place(row)} {what}", where=path, field=field, expected="times that increase", hint=hint
    )


def times_of(table: Table, time: ChannelMap, path: Path) -> tuple[Array, float, float, tuple[str, ...]]:
    """The time column as recorded: values, factor to seconds, what was subtracted, notes."""
    column = table.columns[time.column]
    values = column.values
    notes = tuple(unit_notes("time", column.unit, time))
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
    raw = numbers_of_column(table, time, path)
    known = raw[np.isfinite(raw)]
    if len(known) and abs(float(known[0])) * time.factor > _EPOCH:
        return raw - known[0], time.factor, float(known[0]), (*notes, _since(float(known[0]) * time.factor))
    return raw, time.factor, 0.0, notes


def _since(seconds: float) -> str:
    return f"times count from the first sample, which the file has at {seconds:.9g} s"


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


def unit_notes(role: str, unit: str, channel: ChannelMap) -> list[str]:
    """A note where the file states another unit of the same quantity than the rig file."""
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


def numbers_of_column(table: Table, channel: ChannelMap, path: Path) -> Array:
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
    huge = np.abs(values) > HUGE  # a few bad readings of a sensor are repaired later; a clock must have none
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
