"""Tables in one file: NumPy's own format, bit-exact and without executable content."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from optid.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

TABLES = "tables.npz"
# Largest ratio of unpacked to packed size, and size in bytes that is always accepted.
RATIO, SMALL = 200, 1 << 26
_SEPARATOR = "|"


def write_tables(path: Path, tables: Mapping[str, pd.DataFrame]) -> None:
    """Write tables whose columns hold numbers, booleans or text; no file where there are none."""
    arrays = {}
    for name, frame in tables.items():
        for column in frame:
            values = frame[column].to_numpy()
            arrays[f"{name}{_SEPARATOR}{column}"] = (
                values.astype(str) if values.dtype.kind in "OT" else values
            )
    if arrays:
        np.savez_compressed(path, **arrays)  # type: ignore[arg-type]


def read_tables(path: Path) -> dict[str, pd.DataFrame]:
    """Read what `write_tables` wrote; empty where there is no such file.

    Raises
    ------
    InputError
        the file is damaged.
    """
    import pandas as pd

    if not path.is_file():
        return {}
    columns: dict[str, dict[str, pd.Series]] = {}
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            if sum(one.file_size for one in members) > SMALL + RATIO * path.stat().st_size:
                raise ValueError("it unpacks to more than tables hold")
            for member in members:
                name, _, column = member.filename.removesuffix(".npy").partition(_SEPARATOR)
                values = _array(archive.read(member))
                text = values.dtype.kind == "U"
                columns.setdefault(name, {})[column] = pd.Series(values.tolist() if text else values)
        return {name: pd.DataFrame(frame) for name, frame in columns.items()}
    except Exception as error:  # damaged bytes lead zipfile, NumPy and pandas to exceptions of many kinds
        why = " ".join(f"{error}".split())[:120]
        raise InputError(f"cannot be read ({why})", where=path, expected="tables of a result") from None


def _array(data: bytes) -> NDArray[Any]:
    """The array of an .npy file of one dimension; no more is made than the bytes hold.

    Raises
    ------
    ValueError
        they hold something else.
    """
    file = io.BytesIO(data)
    head = np.lib.format.read_array_header_1_0, np.lib.format.read_array_header_2_0
    shape, _, dtype = head[np.lib.format.read_magic(file) != (1, 0)](file)
    if dtype.hasobject or len(shape) != 1:
        raise ValueError(f"an array of {dtype} and {len(shape)} dimensions")
    return np.frombuffer(data, dtype=dtype, count=shape[0], offset=file.tell()).copy()


def same_tables(one: Mapping[str, pd.DataFrame], other: Mapping[str, pd.DataFrame]) -> bool:
    """The same tables with the same columns and values; missing values are equal."""
    return one.keys() == other.keys() and all(frame.equals(other[name]) for name, frame in one.items())
