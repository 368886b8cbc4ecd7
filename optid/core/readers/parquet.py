"""Apache Parquet."""

from __future__ import annotations

import io
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from optid.core.readers.limits import Budget, shown
from optid.core.readers.table import EXTRA, Column, Raw, Table
from optid.errors import RecordingError

_NAMES = 2000  # listed for messages
_INDEX = re.compile(r"(.+)\[(\d+)\]$")


def read(data: bytes, path: Path, wanted: tuple[str, ...], budget: Budget) -> Table:
    """The columns of a Parquet file that are asked for; a struct's field is "pose.x", a list's element "acc[0]".

    Raises:
        RecordingError: truncated or damaged, a mapped column twice, or pyarrow is not installed.
    """
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        broken = "" if isinstance(error, ModuleNotFoundError) else f" (it is there, but broken: {error})"
        raise RecordingError(f"Parquet files need pyarrow{broken}", where=path, hint=EXTRA) from None
    try:
        file = pq.ParquetFile(io.BytesIO(data))
        names = [file.schema_arrow.field(k).name for k in range(min(len(file.schema_arrow), _NAMES))]
        heads = _heads(file.schema_arrow, wanted)
        rows = int(file.metadata.num_rows)
        budget.take(rows * 8 * max(len(heads), 1), "the columns asked for")
        columns, left_out = {}, {}
        for head, names_of in heads.items():
            parts = (
                [batch.column(0) for batch in file.iter_batches(columns=[head], batch_size=1 << 20)]
                if rows
                else []
            )
            whole = pa.chunked_array(parts) if parts else pa.chunked_array([], type=pa.float64())
            for name in names_of:
                values = _values(pa, whole, name[len(head) :])
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
                f'the column "{shown(head)}" stands twice', where=path, expected="unique names"
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


def _prefixes(name: str) -> Iterator[str]:
    """The name itself, then what stands before each dot or bracket."""
    yield name
    for at in range(len(name) - 1, 0, -1):
        if name[at] in ".[":
            yield name[:at]


def _values(pa: Any, column: Any, rest: str) -> Raw | str:
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
            return f"is no part of it: it is of type {str(kind)[:80]}"
    return _plain(pa, column)


def _plain(pa: Any, column: Any) -> Raw | str:
    kind = column.type
    if pa.types.is_dictionary(kind):
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
