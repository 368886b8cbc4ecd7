"""Apache Parquet."""

from __future__ import annotations

import io
from collections import Counter
from pathlib import Path

from optid.core.readers.table import EXTRA, Table
from optid.errors import RecordingError


def read(data: bytes, path: Path) -> Table:
    """Every column of a Parquet file.

    Raises:
        RecordingError: truncated or damaged, two columns of one name, or pyarrow is not installed.
    """
    try:
        import pyarrow.parquet
    except ImportError:
        raise RecordingError("Parquet files need pyarrow", where=path, hint=EXTRA) from None
    try:
        table = pyarrow.parquet.ParquetFile(io.BytesIO(data)).read()
    except Exception as error:  # pyarrow's own exceptions, OSError, and others on damaged metadata
        reason = " ".join(str(error).split())[:120]
        raise RecordingError(
            f"the Parquet data is truncated or damaged ({reason})", where=path, expected="a complete file"
        ) from None
    twice = [name for name, times in Counter(table.column_names).items() if times > 1]
    if twice:
        raise RecordingError(f'the column "{twice[0]}" stands twice', where=path, expected="unique names")
    frame = table.to_pandas(ignore_metadata=True)
    frame.columns = [str(name) for name in frame.columns]
    return Table(frame, "parquet")
