"""Rows of numbers in shared memory that one process writes and another reads, of a fixed size."""

from __future__ import annotations

import struct
from multiprocessing.shared_memory import SharedMemory

import numpy as np

from optid.core.model import Array

_COUNT = struct.Struct("<q")


class RingBuffer:
    """The last `rows` rows of `columns` numbers.

    Args:
        rows, columns: size.
        name: of one that another process made; a new one if absent.
    """

    def __init__(self, rows: int, columns: int, name: str | None = None) -> None:
        self.rows, self.columns = rows, columns
        size = 8 * (1 + rows * columns)
        self._memory = SharedMemory(name, create=name is None, size=size)
        self._owner = name is None
        assert self._memory.buf is not None
        self._bytes = self._memory.buf
        self._row = struct.Struct(f"<{columns}d")
        if self._owner:
            self._bytes[:size] = bytes(size)

    @property
    def name(self) -> str:
        """Name by which another process opens it."""
        return self._memory.name

    @property
    def count(self) -> int:
        """Rows written so far."""
        return int(_COUNT.unpack_from(self._bytes)[0])

    def add(self, row: tuple[float, ...]) -> None:
        """Write one row; the oldest is overwritten. One writer only."""
        count = self.count
        self._row.pack_into(self._bytes, 8 * (1 + (count % self.rows) * self.columns), *row)
        _COUNT.pack_into(self._bytes, 0, count + 1)

    def since(self, seen: int) -> tuple[int, Array]:
        """The number of rows written, and a copy of those after the first `seen` that are still there.

        Rows that the writer may have overwritten meanwhile are left out.
        """
        count = self.count
        first = max(seen, count - self.rows, 0)
        table = np.frombuffer(self._bytes, dtype="<f8", count=self.rows * self.columns, offset=8)
        picked = np.arange(first, count) % self.rows
        taken: Array = table.reshape(self.rows, self.columns)[picked]
        del table
        lost = max(self.count - self.rows + 1 - first, 0)
        return count, taken[lost:]

    def close(self) -> None:
        """Close it; its creator also removes it."""
        self._memory.close()
        if self._owner:
            self._memory.unlink()
