"""Limits on reading: memory is bounded by what the file really holds, whatever it declares."""

from __future__ import annotations

import zlib
from pathlib import Path

from optid.errors import RecordingError

FLOOR = 64 << 20  # bytes that any file may unpack to
RATIO = 100  # times its size that a file may unpack to: logs shrink 3 to 20 times, one of a channel at rest 100 times
ROWS = 1_000_000  # that any file may have
# Of the file, that it may have beside these: of a bit each, and a row takes 80 bytes of memory.
ROWS_PER_BYTE = 8
PIPE = 512 << 20  # bytes taken from a pipe, which has no size
MEMBERS = 100_000  # gzip streams one after the other in a file: block-wise tools write one for 64 kB
_PIECE = 4 << 20  # bytes unpacked at a time
LONGEST_LINE = 4 << 20  # bytes: 200 000 columns with names
NAMES = 12  # offered in a message
LONGEST_NAME = 60  # characters of a name in a message


class Budget:
    """How much of one file may still be unpacked.

    Args:
        size: bytes of the file.
        path: for messages.
    """

    def __init__(self, size: int, path: Path) -> None:
        self.left, self.path = FLOOR + RATIO * size, path
        self.most_rows = ROWS + ROWS_PER_BYTE * size

    def take(self, count: int, what: str) -> None:
        """Count bytes that are about to be allocated.

        Raises:
            RecordingError: more than the file can really hold.
        """
        if count > self.left:
            raise RecordingError(
                f"{what} would take {count / 1e6:.6g} MB, far more than a file of this size holds",
                where=self.path,
                expected="a file that is not damaged",
                hint="if it is not damaged, save it again without compression or fill values",
            )
        self.left -= count

    def rows(self, count: int) -> None:
        """Look at how many rows a table has.

        Raises:
            RecordingError: more than the file can really hold.
        """
        if count > self.most_rows:
            raise RecordingError(
                f"{count} rows, far more than a file of this size holds",
                where=self.path,
                expected=f"at most {self.most_rows}",
                hint="if it is not damaged, save it again without compression, or in parts",
            )

    def inflate(self, data: bytes | memoryview, what: str, window: int = zlib.MAX_WBITS) -> bytes:
        """Decompress a zlib (or, with `window` 31, one gzip) stream within the budget.

        Raises:
            RecordingError: it unpacks to more than the file may ask for.
            zlib.error: the data are damaged or end early.
        """
        found: list[bytes] = []
        view, at, members = memoryview(data), 0, 0
        while at < len(view):
            at = self._stream(view, at, window, found, what)
            members += 1
            if window == zlib.MAX_WBITS or not (any(view[at : at + 64]) or any(view[at:])):
                break  # tapes and some tools fill up with zeros
            if members == MEMBERS:
                raise zlib.error(f"more than {MEMBERS} parts")
        return b"".join(found) if len(found) != 1 else found[0]

    def _stream(self, view: memoryview, at: int, window: int, found: list[bytes], what: str) -> int:
        """Unpack the stream that begins at a place; where the next one begins.

        Piece by piece: what is refused was not made, and short streams do not copy all that follows them.
        """
        one, size = zlib.decompressobj(window), 1 << 9
        rest: bytes | memoryview = b""
        while not one.eof:
            if not rest:
                rest, at = view[at : at + size], min(at + size, len(view))
                size = min(2 * size, _PIECE)
            made = one.decompress(rest, _PIECE)
            if not (made or len(rest) or one.eof):
                raise zlib.error("it ends in the middle")
            self.take(len(made), what)
            found.append(made)
            rest = one.unconsumed_tail
        return at - len(one.unused_data)


def shown(name: object) -> str:
    """A name from a file, made fit for a message: one line, printable, of bounded length."""
    text = "".join(c if c.isprintable() else "?" for c in str(name)[: LONGEST_NAME + 1])
    return text if len(text) <= LONGEST_NAME else text[: LONGEST_NAME - 3] + "..."
