"""MATLAB .mat files of version 4 to 7, read within the file's own bounds; version 7.3 is HDF5, see `hdf5`.

Written from MathWorks' "MAT-File Format" (R2024a). Everything a damaged file may claim is compared with what it holds
before any of it is made; objects of MATLAB classes are named as such.
"""

from __future__ import annotations

import itertools
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optid.core.readers.limits import Budget, shown
from optid.core.readers.table import Table
from optid.core.readers.tree import Node, Sealed, only_matlab, table_of
from optid.errors import RecordingError

_HEAD = 128  # bytes of text, version and byte order before the first element
_DEEPEST = 24  # structs within structs
_MOST = 1_000_000  # elements together, five or six to a variable, a field or a cell; a second to read
_TYPES = {
    1: "i1",
    2: "u1",
    3: "i2",
    4: "u2",
    5: "i4",
    6: "u4",
    7: "f4",
    9: "f8",
    12: "i8",
    13: "u8",
    16: "u1",
    17: "u2",
}
_MATRIX, _COMPRESSED = 14, 15
_CELL, _STRUCT, _OBJECT, _CHAR, _SPARSE, _FUNCTION, _OPAQUE = 1, 2, 3, 4, 5, 16, 17
_NUMERIC = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
_OLD = ("f8", "f4", "i4", "i2", "u2", "u1")


class _Damaged(ValueError):
    """The bytes do not hold what they say."""


def read(data: bytes, path: Path, wanted: tuple[str, ...], budget: Budget) -> Table:
    """The signals of a .mat file that are asked for: see `tree` for their names.

    Raises:
        RecordingError: truncated or damaged, unpacking to more than it can hold, or without vectors.
    """
    try:
        if data[:6] == b"MATLAB" or data[126:128] in (b"IM", b"MI"):
            root = _File(data, budget).variables()
        else:
            root = dict(_version4(data))
    except (_Damaged, struct.error, zlib.error, ValueError, IndexError, OverflowError) as error:
        reason = " ".join(str(error).split())[:120]
        raise RecordingError(
            f"the .mat data is truncated or damaged ({reason})", where=path, expected="a complete MATLAB file"
        ) from None
    return table_of(root, wanted, path, "mat")


@dataclass(frozen=True)
class _Element:
    kind: int
    data: memoryview


class _File:
    """A file of version 5 to 7."""

    def __init__(self, data: bytes, budget: Budget) -> None:
        order = data[126:128]
        if len(data) < _HEAD or order not in (b"IM", b"MI"):
            raise _Damaged("no byte order mark behind the head")
        self._end = "<" if order == b"IM" else ">"
        self._data, self._budget, self._made = memoryview(data)[_HEAD:], budget, 0

    def variables(self) -> dict[str, Node]:
        """All of them by name; a compressed one is unpacked within the budget."""
        found: dict[str, Node] = {}
        for element in self._elements(self._data):
            if element.kind == _COMPRESSED:
                inner = memoryview(self._budget.inflate(element.data, "a compressed variable"))
                for one in itertools.islice(self._elements(inner), 1):  # it holds one variable
                    self._add(found, one)
            else:
                self._add(found, element)
        return found

    def _add(self, found: dict[str, Node], element: _Element) -> None:
        if element.kind == _MATRIX:
            name, node = self._matrix(element.data, 0)
            if name:
                found[name] = (
                    node if not isinstance(node, Sealed) or not node.cure else only_matlab(node.cure, name)
                )

    def _elements(self, data: memoryview) -> Iterator[_Element]:
        at = 0
        while at + 8 <= len(data):
            self._made += 1
            if self._made > _MOST:
                raise _Damaged("too many elements")
            kind, size = struct.unpack_from(f"{self._end}II", data, at)
            if kind >> 16:  # a small element: size and kind in one word, data in the next
                size, kind = kind >> 16, kind & 0xFFFF
                if size > 4:
                    raise _Damaged("a small element of more than four bytes")
                yield _Element(kind, data[at + 4 : at + 4 + size])
                at += 8
                continue
            if at + 8 + size > len(data):
                raise _Damaged(f"an element of {size} bytes where {len(data) - at - 8} are left")
            yield _Element(kind, data[at + 8 : at + 8 + size])
            at += 8 + size
            if kind != _COMPRESSED:
                at += -at % 8

    def _matrix(self, data: memoryview, depth: int) -> tuple[str, Node]:
        if depth > _DEEPEST:
            raise _Damaged("too many elements within elements")
        if not len(data):
            return "", Sealed("is empty")
        parts = self._elements(data)
        flags = self._numbers(next(parts)).astype(np.uint32)
        kind, is_complex = int(flags[0] & 0xFF), bool(flags[0] & 0x0800)
        if kind == _OPAQUE:
            name, _, title = (self._text(next(parts)) for _ in range(3))
            return name, Sealed("an object", title or "MATLAB")
        shape = tuple(int(n) for n in self._numbers(next(parts)))
        name = self._text(next(parts))
        if any(n < 0 for n in shape) or len(shape) < 2:
            raise _Damaged("sizes that cannot be")
        return name, self._content(kind, shape, parts, is_complex, depth)

    def _content(
        self, kind: int, shape: tuple[int, ...], parts: Iterator[_Element], is_complex: bool, depth: int
    ) -> Node:
        if kind in _NUMERIC:
            return self._array(kind, shape, parts, is_complex)
        if kind == _CHAR:
            letters = self._numbers(next(parts, _Element(2, memoryview(b""))))
            return "".join(map(chr, letters[:4096].tolist())) if shape[0] <= 1 else Sealed("holds text")
        if kind == _CELL:
            return [self._matrix(part.data, depth + 1)[1] for part in parts]
        if kind in (_STRUCT, _OBJECT):
            return self._struct(kind, shape, parts, depth)
        title = {_SPARSE: "is a sparse matrix", _FUNCTION: "is a function"}.get(kind, f"is of class {kind}")
        return Sealed(title)

    def _array(self, kind: int, shape: tuple[int, ...], parts: Iterator[_Element], is_complex: bool) -> Node:
        count = int(np.prod([float(n) for n in shape]))
        real = self._numbers(next(parts, _Element(9, memoryview(b""))))
        if len(real) < count or count > len(real):
            raise _Damaged(f"{count} values are announced, {len(real)} are there")
        if is_complex:
            return Sealed("holds complex numbers")
        # Stored small where values allow; made as large as their class only when a signal is used.
        return real[:count].reshape(shape, order="F")

    def _struct(self, kind: int, shape: tuple[int, ...], parts: Iterator[_Element], depth: int) -> Node:
        if kind == _OBJECT:
            return Sealed("an object", self._text(next(parts)))
        width = int(self._numbers(next(parts))[0])
        names = bytes(next(parts).data)
        if width <= 0 and names:
            raise _Damaged("field names without a length")
        fields = [
            names[k : k + width].split(b"\0")[0].decode("utf-8", "replace")
            for k in range(0, len(names), max(width, 1))
        ]
        count = int(np.prod([float(n) for n in shape]))
        if count * max(len(fields), 1) > _MOST // 5:
            raise _Damaged("more elements than a file holds")
        structs = []
        for _ in range(count):
            one: dict[str, Node] = {}
            for field in fields:
                node = self._matrix(next(parts, _Element(0, memoryview(b""))).data, depth + 1)[1]
                sealed = isinstance(node, Sealed) and bool(node.cure)
                one[field] = only_matlab(node.cure, field) if sealed else node
            structs.append(one)
        return structs[0] if count == 1 else structs

    def _numbers(self, element: _Element) -> NDArray[Any]:
        if element.kind not in _TYPES:
            raise _Damaged(f"data of type {element.kind}")
        kind = np.dtype(self._end + _TYPES[element.kind])
        return np.frombuffer(element.data[: len(element.data) // kind.itemsize * kind.itemsize], dtype=kind)

    def _text(self, element: _Element) -> str:
        return shown(bytes(element.data[:256]).decode("utf-8", "replace")) if len(element.data) else ""


def _version4(data: bytes) -> Iterator[tuple[str, Node]]:
    at = 0
    order = "<" if len(data) >= 4 and struct.unpack_from("<i", data)[0] < 10_000 else ">"
    while at + 20 <= len(data):
        form, rows, columns, imaginary, length = struct.unpack_from(f"{order}5i", data, at)
        precision, kind = form // 10 % 10, form % 10
        if (
            not 0 <= form <= 4052
            or precision > 5
            or kind > 2
            or min(rows, columns) < 0
            or not 0 < length < 4096
        ):
            raise _Damaged(f"no variable at byte {at}")
        values = np.dtype(order + _OLD[precision])
        size = rows * columns * values.itemsize * (2 if imaginary else 1)
        begin = at + 20 + length
        if begin + size > len(data):
            raise _Damaged(f"{size} bytes are announced, {max(len(data) - begin, 0)} are there")
        name = data[at + 20 : begin].split(b"\0")[0].decode("latin-1")
        if kind or imaginary:
            yield (
                name,
                Sealed(
                    "holds text" if kind == 1 else "is a sparse matrix" if kind else "holds complex numbers"
                ),
            )
        else:
            found = np.frombuffer(data, dtype=values, count=rows * columns, offset=begin)
            yield name, found.reshape((rows, columns), order="F")
        at = begin + size
    if at < len(data):
        raise _Damaged("it ends in the middle of a variable")
