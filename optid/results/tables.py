"""Tables in one file: NumPy's own format, exact to the bit, and without anything that could run."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from optid.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

TABLES = "tables.npz"
_SEPARATOR = "|"


def write_tables(path: Path, tables: Mapping[str, pd.DataFrame]) -> None:
    """Write tables whose columns hold numbers, truth values or text; nothing where there are none."""
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
        with np.load(path, allow_pickle=False) as arrays:
            for key in arrays.files:
                name, _, column = key.partition(_SEPARATOR)
                values = arrays[key]
                text = values.dtype.kind == "U"
                columns.setdefault(name, {})[column] = pd.Series(values.tolist() if text else values)
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise InputError(f"cannot be read ({error})", where=path, expected="tables of a result") from None
    return {name: pd.DataFrame(frame) for name, frame in columns.items()}


def same_tables(one: Mapping[str, pd.DataFrame], other: Mapping[str, pd.DataFrame]) -> bool:
    """The same tables with the same columns and values; missing values are equal."""
    return one.keys() == other.keys() and all(frame.equals(other[name]) for name, frame in one.items())
