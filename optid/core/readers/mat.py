"""MATLAB .mat files: version 4 to 7 through SciPy, 7.3 (which is HDF5) through h5py."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optid.core.readers.table import EXTRA, Table, tabulate
from optid.errors import RecordingError

HDF5 = b"\x89HDF\r\n\x1a\n"
_USER_BLOCK = 512  # bytes MATLAB 7.3 writes in front of the HDF5 data


def read(data: bytes, path: Path) -> Table:
    """Every numeric vector of a .mat file; the columns of an n-by-k matrix become name[0], name[1], ...

    Fields of structs are named "struct.field"; scalars, text and cells are no signals and are passed over.

    Raises:
        RecordingError: truncated or damaged, no vectors, or h5py is not installed and needed.
    """
    hdf5 = HDF5 in (data[:8], data[_USER_BLOCK : _USER_BLOCK + 8])
    variables = _hdf5(data, path) if hdf5 else _classic(data, path)
    vectors: dict[str, NDArray[np.generic]] = {}
    for name, values in _signals(variables):
        if values.shape[1] == 1:
            vectors[name] = values[:, 0]
        else:
            vectors |= {f"{name}[{k}]": values[:, k] for k in range(values.shape[1])}
    return tabulate(vectors, path, "mat 7.3" if hdf5 else "mat")


def _classic(data: bytes, path: Path) -> Mapping[str, Any]:
    import scipy.io

    file: Any = io.BytesIO(data)  # SciPy takes an open file, its stubs do not know

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # SciPy warns of variables it cannot read; they are no signals
            found: dict[str, Any] = scipy.io.loadmat(file, simplify_cells=True)
    except Exception as error:  # SciPy raises whatever the damaged bytes lead it to
        raise _damaged(error, path) from None
    return {name: value for name, value in found.items() if not name.startswith("__")}


def _hdf5(data: bytes, path: Path) -> Mapping[str, Any]:
    try:
        import h5py
    except ImportError:
        raise RecordingError(".mat files of version 7.3 need h5py", where=path, hint=EXTRA) from None

    def held(group: Any) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for name, item in group.items():
            if name.startswith("#"):  # where MATLAB keeps the contents of cells
                continue
            if isinstance(item, h5py.Group):
                found[name] = held(item)
            elif (
                item.attrs.get("MATLAB_class", b"") not in (b"char", b"cell")
                and "MATLAB_empty" not in item.attrs
            ):
                found[name] = np.asarray(item[()]).T  # MATLAB stores columns first
        return found

    try:
        with h5py.File(io.BytesIO(data), "r") as file:
            return held(file)
    except Exception as error:  # h5py raises OSError, KeyError or RuntimeError on damaged data
        raise _damaged(error, path) from None


def _damaged(error: Exception, path: Path) -> RecordingError:
    reason = " ".join(f"{type(error).__name__} {error}".split())[:120]
    return RecordingError(
        f"the .mat data is truncated or damaged ({reason})", where=path, expected="a complete MATLAB file"
    )


def _signals(variables: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, NDArray[np.generic]]]:
    """Numeric arrays of at least two samples as (samples, columns); a row vector is turned."""
    for name, value in variables.items():
        if isinstance(value, Mapping):
            yield from _signals(value, f"{prefix}{name}.")
            continue
        array = np.asarray(value)
        if array.dtype.kind not in "biufc" or array.ndim > 2 or array.size < 2:
            continue
        array = np.atleast_2d(array)
        yield prefix + name, array.T if array.shape[0] == 1 else array
