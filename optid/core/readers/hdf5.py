"""HDF5: MATLAB 7.3 and files of other origin. Links out of the file and data that are stored elsewhere are refused."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from optid.core.readers.libraries import library
from optid.core.readers.limits import Budget, shown
from optid.core.readers.table import Table
from optid.core.readers.tree import Node, Sealed, only_matlab, table_of
from optid.errors import RecordingError

MAGIC = b"\x89HDF\r\n\x1a\n"
_BLOCKS = (0, 512, 1024, 2048)  # where the data may begin behind a user block; MATLAB writes 512 bytes
_DEEPEST = 24
_MOST = 10_000  # objects looked at, those asked for first; 3 s
_LONGEST_TITLE = 1000  # bytes of a class's name
_CELLS = 4096  # elements of a cell array or struct array that are looked at


def is_hdf5(data: bytes) -> bool:
    """It begins as HDF5 does, possibly behind a user block."""
    return any(data[at : at + 8] == MAGIC for at in _BLOCKS)


def read(data: bytes, path: Path, wanted: tuple[str, ...], budget: Budget) -> Table:
    """The signals of an HDF5 file that are asked for: see `tree` for their names.

    Raises:
        RecordingError: truncated or damaged, data outside the file, more than it can hold, or h5py is not installed.
    """
    h5py = library("h5py", "h5py", "HDF5 and .mat files of version 7.3", path)
    matlab = data[:6] == b"MATLAB"
    try:
        with h5py.File(io.BytesIO(data), "r") as file:
            root = _Walk(h5py, file, budget, wanted).group(file, "", 0)
            return table_of(root, wanted, path, "mat 7.3" if matlab else "hdf5")
    except RecordingError:
        raise
    except Exception as error:  # h5py raises OSError, KeyError, RuntimeError and others on damaged data
        reason = " ".join(f"{type(error).__name__} {error}".split())[:120]
        kind = "a complete MATLAB file" if matlab else "a complete HDF5 file"
        name = ".mat" if matlab else "HDF5"
        raise RecordingError(
            f"the {name} data is truncated or damaged ({reason})", where=path, expected=kind
        ) from None


@dataclass(frozen=True, eq=False)
class _Stored:
    """A dataset, or one field of its records, that is read when a signal is used."""

    dataset: Any
    budget: Budget
    field: str | None = None

    @property
    def shape(self) -> tuple[int, ...]:
        own = self.dataset.dtype[self.field].shape if self.field is not None else ()
        return tuple(int(n) for n in (*self.dataset.shape, *own))

    @property
    def dtype(self) -> np.dtype[Any]:
        kind: np.dtype[Any] = self.dataset.dtype
        return kind[self.field].base if self.field is not None else kind

    def __getitem__(self, key: Any) -> Any:
        # Chunks are unpacked whole, so the whole dataset counts, whatever part of it is asked for; and a chunk may
        # be larger than what is used of it.
        values = max(self.dataset.size, math.prod(self.dataset.chunks or ()))
        name = shown(self.dataset.name)
        self.budget.take(values * self.dataset.dtype.itemsize, f'the dataset "{name}"')
        return self.dataset[self.field][key] if self.field is not None else self.dataset[key]


def _title(item: Any) -> str:
    """The MATLAB class that a file states; one that takes more than a name does is none."""
    if (
        "MATLAB_class" not in item.attrs
        or item.attrs.get_id("MATLAB_class").get_storage_size() > _LONGEST_TITLE
    ):
        return ""
    title = item.attrs["MATLAB_class"]
    return title.decode("utf-8", "replace") if isinstance(title, bytes) else str(title)


class _Walk:
    """Through the groups of a file, each once, whatever links lead to it."""

    def __init__(self, h5py: Any, file: Any, budget: Budget, wanted: Iterable[str]) -> None:
        self._h5py, self._file, self._budget = h5py, file, budget
        self._asked = {part for name in wanted for part in re.split(r"[./\[\](){}]", name)}
        self._seen: set[int] = set()
        self._count = 0

    def group(self, group: Any, name: str, depth: int) -> dict[str, Node]:
        found: dict[str, Node] = {}
        for key in sorted(group, key=lambda key: key not in self._asked):
            if depth > _DEEPEST or self._count > _MOST:
                break
            if key.startswith("#"):  # where MATLAB keeps the contents of cells
                continue
            full = f"{name}.{key}" if name else key
            link = group.get(key, getlink=True)
            if isinstance(link, self._h5py.ExternalLink):
                found[key] = Sealed("is a link to another file, which is not followed")
                continue
            try:
                item = group.get(key)
            except (RuntimeError, OSError):  # links in a circle
                found[key] = Sealed("is a link that leads nowhere")
                continue
            if item is not None:
                found[key] = self._node(item, full, depth)
        return found

    def _node(self, item: Any, name: str, depth: int) -> Node:
        self._count += 1
        title = _title(item)
        if isinstance(item, self._h5py.Group):
            address = int(self._h5py.h5o.get_info(item.id).addr)
            if address in self._seen:
                return Sealed("is a link to a group that was already read")
            self._seen.add(address)
            fields = self.group(item, name, depth + 1)
            return self._structs(fields) if title == "struct" else fields
        if not isinstance(item, self._h5py.Dataset):
            return Sealed("is a data type without data")
        return self._dataset(item, title, name, depth)

    def _dataset(self, item: Any, title: str, name: str, depth: int) -> Node:
        if item.external or item.is_virtual:
            return Sealed("is stored in another file, which is not opened")
        if "MATLAB_object_decode" in item.attrs or title in ("string", "datetime", "function_handle"):
            return only_matlab(title or "MATLAB", name)
        if "MATLAB_empty" in item.attrs or item.shape is None:
            return Sealed("is empty")
        if title == "char":
            return self._text(item)
        if self._h5py.check_ref_dtype(item.dtype) is self._h5py.Reference:
            return list(self._cells(item, name, depth))
        if item.dtype.names:
            if title or set(item.dtype.names) == {"real", "imag"}:
                return Sealed("holds complex numbers")
            return {field: _Stored(item, self._budget, field) for field in item.dtype.names}
        if item.dtype.kind not in "biufcmM":
            return Sealed("holds text")
        if item.size > 1 and item.id.get_storage_size() == 0:
            return Sealed("is announced, but was never written")
        return _Stored(item, self._budget)

    def _text(self, item: Any) -> Node:
        if item.size > 4096 or item.dtype.kind not in "iu":
            return Sealed("holds text")
        return "".join(map(chr, np.asarray(_Stored(item, self._budget)[()]).reshape(-1).tolist()))

    def _cells(self, item: Any, name: str, depth: int) -> Iterator[Node]:
        if depth > _DEEPEST or item.size > _CELLS:
            return
        for k, reference in enumerate(np.asarray(_Stored(item, self._budget)[()]).reshape(-1)):
            if self._count > _MOST:
                return
            target = self._file[reference] if reference else None
            yield Sealed("is empty") if target is None else self._node(target, f"{name}[{k}]", depth + 1)

    def _structs(self, fields: dict[str, Node]) -> Node:
        """A struct array is stored as a struct of lists; of one element only, as plain fields."""
        lengths = {len(node) for node in fields.values() if isinstance(node, list)}
        if len(lengths) != 1 or not all(isinstance(node, list) for node in fields.values()):
            return fields
        return [{key: node[k] for key, node in fields.items()} for k in range(lengths.pop())]
