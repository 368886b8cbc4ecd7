"""Apache Parquet."""

from __future__ import annotations

import io
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from optid.core.readers.libraries import library
from optid.core.readers.limits import Budget, shown
from optid.core.readers.table import Column, Raw, Table
from optid.errors import RecordingError

_NAMES = 2000  # listed for messages
_MOST_LEAVES = 100_000  # columns looked at
LONGEST_TEXT = 1000  # bytes of a cell that can be a number, a date or a word
_INDEX = re.compile(r"(.+)\[(\d+)\]$")


def read(data: bytes, path: Path, wanted: tuple[str, ...], budget: Budget) -> Table:
    """The columns of a Parquet file that are asked for; a struct's field is "pose.x", a list's element "acc[0]".

    Raises:
        RecordingError: truncated or damaged, a mapped column twice, or pyarrow is not installed.
    """
    pq = library("pyarrow.parquet", "pyarrow", "Parquet files", path)
    pa = library("pyarrow", "pyarrow", "Parquet files", path)
    library("pyarrow.compute", "pyarrow", "Parquet files", path)
    try:
        file = pq.ParquetFile(io.BytesIO(data))
        schema, rows = file.schema_arrow, int(file.metadata.num_rows)
        names = [schema.field(k).name for k in range(min(len(schema), _NAMES))]
        heads = _heads(schema, wanted)
        budget.take(8 * _count(file.metadata, rows, heads), "the columns asked for")
        if texts := [head for head in heads if _is_text(pa, schema.field(head).type)]:
            # Each text once: a page that repeats one of a megabyte a thousand times takes a few bytes.
            file = pq.ParquetFile(io.BytesIO(data), read_dictionary=texts)
        columns, left_out = {}, {}
        for head, names_of in heads.items():
            parts = (
                [batch.column(0) for batch in file.iter_batches(columns=[head], batch_size=1 << 20)]
                if rows
                else []
            )
            whole = pa.chunked_array(parts) if parts else pa.chunked_array([], type=pa.float64())
            for name in names_of:
                values = _values(pa, whole, name[len(head) :], budget)
                if isinstance(values, str):
                    left_out[name] = values
                else:
                    columns[name] = Column(values)
    except RecordingError:
        raise
    except Exception as error:  # pyarrow's own exceptions, OSError, and others on damaged metadata
        reason = " ".join(str(error).split())[:120]
        raise RecordingError(
            f"the Parquet data is truncated or damaged ({reason})", where=path, expected="a complete file"
        ) from None
    twice = Counter(names)
    for head in heads:
        if twice[head] > 1:
            raise RecordingError(
                f'the column "{shown(head)}" occurs twice', where=path, expected="unique names"
            )
    return Table(columns, names, "parquet", "", left_out)


def _heads(schema: Any, wanted: tuple[str, ...]) -> dict[str, list[str]]:
    """Top-level column -> names asked for that lie in it."""
    found: dict[str, list[str]] = {}
    for name in wanted:
        for head in _prefixes(name):
            if schema.get_all_field_indices(head):
                found.setdefault(head, []).append(name)
                break
    return found


def _count(metadata: Any, rows: int, heads: Iterable[str]) -> int:
    """Values that the columns hold, those of lists included."""
    count, wanted = 0, set(heads)
    places = [
        k
        for k in range(min(metadata.num_columns, _MOST_LEAVES))
        if wanted & set(_prefixes(metadata.schema.column(k).path))
    ]
    for group in range(metadata.num_row_groups):
        held = metadata.row_group(group)
        count += sum(int(held.column(k).num_values) for k in places)
    return max(count, rows * len(wanted))


def _is_text(pa: Any, kind: Any) -> bool:
    plain = pa.types.is_string(kind) or pa.types.is_binary(kind)
    return bool(plain or pa.types.is_large_string(kind) or pa.types.is_large_binary(kind))


def _prefixes(name: str) -> Iterator[str]:
    """The name itself, then what stands before each dot or bracket."""
    yield name
    for at in range(len(name) - 1, 0, -1):
        if name[at] in ".[":
            yield name[:at]


def _values(pa: Any, column: Any, rest: str, budget: Budget) -> Raw | str:
    """What a column holds along a path such as ".position.x" or "[2]"; or why it is no signal."""
    for field, index in re.findall(r"\.([^.\[]+)|\[(\d+)\]", rest):
        kind = column.type
        if field and pa.types.is_struct(kind) and kind.get_field_index(field) >= 0:
            column = pa.compute.struct_field(column, field)
        elif index and (
            pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind) or pa.types.is_large_list(kind)
        ):
            column = pa.compute.list_element(column, int(index))
        else:
            return f"cannot be selected: the column is of type {str(kind)[:80]}"
    return _plain(pa, column, budget)


def _longest(pa: Any, texts: Any) -> int:
    return int(pa.compute.max(pa.compute.binary_length(texts)).as_py() or 0)


def _plain(pa: Any, column: Any, budget: Budget) -> Raw | str:
    kind = column.type
    if pa.types.is_dictionary(kind):
        if _is_text(pa, kind.value_type):
            longest = max((_longest(pa, chunk.dictionary) for chunk in column.chunks), default=0)
            if longest > LONGEST_TEXT:
                return f"holds texts of up to {longest} bytes instead of numbers"
            budget.take(len(column) * longest, "a column of texts")
        column = column.cast(kind.value_type)
        kind = column.type
    if pa.types.is_struct(kind):
        fields = [kind.field(k).name for k in range(min(kind.num_fields, 8))]
        return f"is a struct: map one of its fields, {', '.join(shown(f) for f in fields)}, as NAME.FIELD"
    if pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind) or pa.types.is_large_list(kind):
        return "is a list: map one of its elements as NAME[0]"
    if pa.types.is_decimal(kind):
        column = column.cast(pa.float64())
    elif pa.types.is_time(kind):
        column = column.cast(pa.int64() if kind.bit_width == 64 else pa.int32()).cast(pa.int64())
        unit = str(kind)[str(kind).index("[") + 1 : -1]
        return np.asarray(column.cast(pa.duration(unit)).to_numpy())
    elif pa.types.is_date(kind):
        column = column.cast(pa.timestamp("ms"))
    elif pa.types.is_timestamp(kind) and kind.tz is not None:
        column = column.cast(pa.timestamp(kind.unit))
    return np.asarray(column.to_numpy())
