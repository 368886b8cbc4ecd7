"""Raw columns of a recording file, whatever its format."""

from __future__ import annotations

import gzip
import hashlib
import zlib
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from optid.errors import RecordingError

if TYPE_CHECKING:
    import pandas as pd

FORMATS = "CSV, Parquet, MATLAB .mat or TDMS"
EXTRA = 'run pip install "optid[formats]"'


@dataclass(frozen=True, eq=False)
class Table:
    """What a file holds before any column has a meaning.

    Attributes:
        frame: one column per signal, as the file has it: numbers, or objects where there is text.
        reader: name of the format.
        lines: for text formats the line of the file each row stands in, shape (rows,).
        left_out: column -> why it is not in `frame`.
        notes: rows or columns dropped, in words.
    """

    frame: pd.DataFrame
    reader: str
    lines: NDArray[np.int64] | None = None
    left_out: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def place(self, row: int) -> str:
        """How a person finds a row (counted from 0 here): its line in a text file, else its row from 1."""
        return f"row {row + 1}" if self.lines is None else f"line {self.lines[row]}"


def read_table(path: Path) -> tuple[Table, str]:
    """Read a file's columns; its first bytes tell the format, or else its suffix.

    Returns:
        The table and the sha256 of the file's bytes.

    Raises:
        RecordingError: missing, a directory, not readable, empty, truncated, or of no known format.
    """
    data = _bytes(path)
    digest = hashlib.sha256(data).hexdigest()
    name = path.name.lower()
    if data[:2] == b"\x1f\x8b" or name.endswith(".gz"):
        data, name = _unzipped(data, path), name.removesuffix(".gz")
    if not data.strip():
        raise RecordingError("the file is empty", where=path, expected=f"a table as {FORMATS}")
    return _reader(data, name, path)(data, path), digest


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except FileNotFoundError:
        message = "no such file"
        near = sorted(p.name for p in path.parent.iterdir()) if path.parent.is_dir() else []
        raise RecordingError(message, where=path, hint=_did_you_mean(path.name, near)) from None
    except IsADirectoryError:
        raise RecordingError("this is a directory", where=path, expected="a recording file") from None
    except PermissionError:
        # Windows reports a directory this way, too.
        message = "this is a directory" if path.is_dir() else "no permission to read it"
        raise RecordingError(message, where=path, expected="a readable file") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise RecordingError(f"cannot be read ({error})", where=path) from None


def _did_you_mean(name: str, candidates: list[str]) -> str | None:
    from optid.errors import nearest

    hint = nearest(name, candidates)
    return hint if hint.startswith("did") else None


def _unzipped(data: bytes, path: Path) -> bytes:
    try:
        return gzip.decompress(data)
    except (EOFError, zlib.error, OSError) as error:
        raise RecordingError(
            f"the gzip data is truncated or damaged ({error})", where=path, expected="a complete .gz file"
        ) from None


def _reader(data: bytes, name: str, path: Path) -> Callable[[bytes, Path], Table]:
    """The reader of a format; each is imported only when a file asks for it."""
    from optid.core.readers import mat, parquet, tdms, text

    suffix = Path(name).suffix
    if data[:4] == b"PAR1" or suffix in (".parquet", ".pq"):
        return parquet.read
    if data[:4] in (b"TDSm", b"TDSh") or suffix == ".tdms":
        return tdms.read
    if data[:6] == b"MATLAB" or data[:8] == mat.HDF5 or suffix in (".mat", ".h5", ".hdf5"):
        return mat.read
    if data[:2] == b"PK":
        raise RecordingError(
            "this is a zip archive or a spreadsheet", where=path, expected=f"a table as {FORMATS}"
        )
    return text.read


def tabulate(vectors: Mapping[str, NDArray[np.generic]], path: Path, reader: str) -> Table:
    """Join vectors into a table: the length most of them share is the number of rows (ties: the longest).

    Raises:
        RecordingError: there are none, or none holds two samples.
    """
    import pandas as pd

    lengths = Counter(len(vector) for vector in vectors.values() if len(vector) > 1)
    if not lengths:
        raise RecordingError(
            "no vector of samples in it", where=path, expected="signals as vectors of one length"
        )
    rows = max(lengths, key=lambda length: (lengths[length], length))
    kept = {name: vector for name, vector in vectors.items() if len(vector) == rows}
    left_out = {
        name: f"has {len(vector)} values where most columns have {rows}"
        for name, vector in vectors.items()
        if name not in kept
    }
    notes = tuple(f'"{name}" is left out: it {why}' for name, why in left_out.items())
    return Table(pd.DataFrame(kept), reader, left_out=left_out, notes=notes)
