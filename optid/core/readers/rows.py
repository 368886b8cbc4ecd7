"""The rows of a text table: which lines are data, that each has as many cells, and where each stands in the file."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from optid.core.readers.cells import is_missing, is_value
from optid.core.readers.layout import Layout, has_decimal_comma, split
from optid.errors import RecordingError

Integers = NDArray[np.int64]
Counts = NDArray[np.int32]
_CHUNK = 8 << 20  # bytes looked at at a time
_COMMENT = re.compile(rb"^[ \t]*(?:[#%]|//)[^\n]*(?:\n|\Z)", re.MULTILINE)
_FOOT = 200  # lines below a table that may be something else
_PIECE = 8 << 20  # bytes read at a time
_NEWLINE, _RETURN, _BLANKS = 10, 13, (32, 9)
_BLANK_LINE = 64  # signs: a longer line holds something


@dataclass(frozen=True, eq=False)
class Lines:
    """Where each row stands in its file: rows, blank lines and comments are counted off.

    Attributes:
        begins: number of file lines above the rows.
        blank: lines without a cell, counted from the first row's, comments left out; increasing.
        comments: file lines (counted from 0) of comments among the rows; increasing.
    """

    begins: int
    blank: Integers
    comments: Integers

    def of_row(self, row: int) -> int:
        """Index of the line of the file that a row (counted from 0) stands in."""
        line = row + int(np.searchsorted(self.blank - np.arange(len(self.blank)), row, side="right"))
        above = self.comments - self.begins - np.arange(len(self.comments))
        return self.begins + line + int(np.searchsorted(above, line, side="right"))

    def place(self, row: int) -> str:
        """The line of the file that a row stands in, in words."""
        return f"line {self.of_row(row) + 1}"


@dataclass(frozen=True, eq=False)
class Rows:
    """The data lines of a table.

    Attributes:
        body: their bytes, without comments and what stands below the table; blank lines may be among them.
        encoding: of the bytes.
        width: cells of most rows.
        widest: cells of the longest row that is let pass (a delimiter at its end makes one more).
        notes: what was left out.
        lines: where each row stands in the file.
        count: rows.
    """

    body: bytes
    encoding: str
    width: int
    widest: int
    notes: tuple[str, ...]
    lines: Lines
    count: int

    @classmethod
    def of(cls, data: bytes, encoding: str, layout: Layout, path: Path) -> Rows:
        """Cut the rows out of a file and check their lengths.

        Raises:
            RecordingError: a row with too many cells, or with none for a mapped column; no row at all.
        """
        start = _offset(data, layout.first)
        stop, below = _end(data, start, encoding, layout)
        body, comments = _without_comments(data[start:stop], layout.first)
        notes: tuple[str, ...] = (f"{below} lines below the table are skipped",) if below else ()
        single = len(layout.names) == 1
        if single:  # a blank line is a missing sample
            body = re.sub(rb"(?m)^[ \t\r]*$", b"nan", body.rstrip())
        counts, blank = _counts(body, layout.delimiter)
        if len(blank):
            notes += (f"{len(blank)} blank lines are skipped",)
        lines = Lines(layout.first, blank, np.array(comments, dtype=np.int64))
        width = 1 if single else _usual(counts)
        found = cls(body, encoding, width, int(counts.max(initial=1)), notes, lines, len(counts))
        found._check(counts, layout, path)
        return found

    def pieces(self) -> Iterator[bytes]:
        """The rows in pieces, so that what is made of one takes little beside them all."""
        at = 0
        while at < len(self.body):
            stop = len(self.body)
            if at + _PIECE < stop:
                stop = self.body.find(b"\n", at + _PIECE) + 1 or stop
            yield self.body[at:stop]
            at = stop

    def sample(self) -> Iterator[str]:
        """The first rows and the last ones."""
        size = 1 << 18
        for part in (self.body[:size], self.body[max(size, len(self.body) - size) :]):
            yield from (
                line for line in part.decode(self.encoding, "replace").splitlines()[1:-1] if line.strip()
            )

    def decimal_comma(self, layout: Layout) -> bool:
        """Some column of the table has decimal commas."""
        rows = [split(line, layout.delimiter) for line in self._some]
        return layout.delimiter != "," and has_decimal_comma(rows, range(self.width))

    @cached_property
    def _some(self) -> list[str]:
        return list(self.sample())[:4000]

    def _check(self, counts: Counts, layout: Layout, path: Path) -> None:
        if not len(counts):
            raise RecordingError("no rows of numbers", where=path, expected="rows below the header")
        named = len(layout.names)
        if layout.header is not None and layout.delimiter != " " and self.width > named + 1:
            commas = layout.delimiter == "," and self.width == 2 * named
            raise RecordingError(
                f"line {layout.first + 1} has {self.width} fields",
                where=path,
                expected=f"{named}, as in the header",
                hint="if these are decimal commas, export with semicolons between the columns"
                if commas
                else None,
            )
        self._refuse_unnamed(layout, path)
        short = counts <= max(layout.places)
        # One cell more is a delimiter at the end of the line; any other surplus moves what stands behind it.
        long = counts > self.width + (layout.delimiter != " ")
        extra = np.flatnonzero(counts == self.width + 1)
        wrong = np.flatnonzero(short | long)
        if len(extra) and not (short | long).any() and layout.delimiter != " ":
            wrong = np.array(list(self._open_ended(extra, layout)), dtype=np.int64)
        if not len(wrong):
            return
        row = int(wrong[0])
        count, line = int(counts[row]), self.lines.of_row(row)
        last = row == len(counts) - 1
        mixed = layout.delimiter == "," and self.width < count <= 2 * self.width
        torn = next(itertools.islice(self._filled, row, None), b"").count(b'"') % 2 == 1
        hint = "the file may be truncated" if last else None
        if mixed:
            hint = "if these are decimal commas, export with semicolons between the columns"
        elif torn:
            hint = "a quoted cell spans several lines: export the table without that column"
        raise RecordingError(
            f"line {line + 1} has {count} {'field' if count == 1 else 'fields'}",
            where=path,
            expected=f"{len(layout.names) if count > self.width else self.width}, as in the header",
            hint=hint,
        )

    def _refuse_unnamed(self, layout: Layout, path: Path) -> None:
        """Every row holds one value more than the header has names: which of them has none is not known."""
        if (
            layout.header is None
            or layout.delimiter == " "
            or self.width != len(layout.names) + 1
            or self.width == 2
        ):
            return
        rows = [split(line, layout.delimiter) for line in self._some[:50]]
        if rows and all(len(row) == self.width and row[-1] for row in rows):
            raise RecordingError(
                f"line {layout.first + 1} has {self.width} fields",
                where=path,
                expected=f"{len(layout.names)}, as in the header",
                hint='name every column in the header, or select columns by position: "column 1"',
            )

    @property
    def _filled(self) -> Iterator[bytes]:
        return (text for text in self.body.split(b"\n") if text.strip())

    def _open_ended(self, rows: Integers, layout: Layout) -> Iterator[int]:
        """Those of these rows that do not end in a delimiter."""
        chosen = set(rows.tolist())
        seen = -1
        for text in self.body.split(b"\n"):
            seen += bool(text.strip())
            if (
                text.strip()
                and seen in chosen
                and split(text.decode(self.encoding, "replace"), layout.delimiter)[-1]
            ):
                yield seen
                return


def _offset(data: bytes, line: int) -> int:
    at = 0
    for _ in range(line):
        at = data.find(b"\n", at) + 1
    return at


def _end(data: bytes, start: int, encoding: str, layout: Layout) -> tuple[int, int]:
    """Where the last row ends, and how many lines of text stand below it."""
    stop, below = len(data), 0
    for _ in range(_FOOT):
        begin = max(data.rfind(b"\n", start, stop), start - 1) + 1
        line = data[begin:stop].decode(encoding, "replace").strip("\r\x1a \t")
        cells = split(line, layout.delimiter)
        # The first mapped column holds words ("Mean", "End of data"), or the line nothing that is a value at all.
        lead = cells[layout.places[0]] if len(cells) > layout.places[0] else ""
        values = any(is_value(cell) for cell in cells[: max(layout.places) + 1])
        empty = all(map(is_missing, cells))
        prose = bool(line) and not empty and (not values or not (is_value(lead) or is_missing(lead)))
        if begin <= start or (line and not prose):
            break
        below += bool(prose) and not line.startswith(("#", "%", "//"))
        stop = begin - 1
    else:
        return len(data), 0
    return stop, below


def _without_comments(body: bytes, first: int) -> tuple[bytes, tuple[int, ...]]:
    if not (b"#" in body or b"%" in body or b"//" in body):
        return body, ()
    dropped = []
    at, line = 0, first
    for match in _COMMENT.finditer(body):
        line += body.count(b"\n", at, match.start())
        dropped.append(line)
        at = match.start()
    return (_COMMENT.sub(b"", body), tuple(dropped)) if dropped else (body, ())


def _counts(body: bytes, delimiter: str) -> tuple[Counts, Integers]:
    """Cells of every line that is not blank, and the blank ones between them, counted from the first line."""
    counts: list[Counts] = []
    blank: list[Integers] = []
    at, line = 0, 0
    while at < len(body):
        stop = len(body) if at + _CHUNK >= len(body) else body.rfind(b"\n", at, at + _CHUNK) + 1
        stop = stop if stop > at else len(body)
        piece = body[at:stop]
        found = _quoted(piece, delimiter) if b'"' in piece else _plain(piece, delimiter)
        counts.append(found[found > 0])
        blank.append(line + np.flatnonzero(found == 0))
        at, line = stop, line + len(found)
    return (
        np.concatenate(counts) if counts else np.empty(0, dtype=np.int32),
        np.concatenate(blank) if blank else np.empty(0, dtype=np.int64),
    )


def _plain(piece: bytes, delimiter: str) -> Counts:
    """Cells of every line, 0 for a blank one."""
    signs = np.frombuffer(piece, dtype=np.uint8)
    ends = np.flatnonzero(signs == _NEWLINE)
    if not piece.endswith(b"\n"):
        ends = np.append(ends, len(signs))
    if delimiter == " ":
        solid = _solid(signs)
        marks = np.flatnonzero(solid & ~np.concatenate(([False], solid[:-1])))  # where a cell begins
        return np.diff(np.searchsorted(marks, ends), prepend=0).astype(np.int32)
    marks = np.flatnonzero(signs == ord(delimiter))
    counts = (np.diff(np.searchsorted(marks, ends), prepend=0) + 1).astype(np.int32)
    begins = np.concatenate(([0], ends[:-1] + 1))
    doubtful = np.flatnonzero((counts == 1) & (ends - begins < _BLANK_LINE))
    if delimiter == "\t":  # a line of tabs holds no value, but cells
        doubtful = doubtful[ends[doubtful] - begins[doubtful] < 2]
    for k in doubtful:
        counts[k] = bool(_solid(signs[begins[k] : ends[k]]).any())
    return counts


def _solid(signs: NDArray[np.uint8]) -> NDArray[np.bool_]:
    return np.asarray(
        (signs != _NEWLINE) & (signs != _RETURN) & (signs != _BLANKS[0]) & (signs != _BLANKS[1])
    )


def _quoted(piece: bytes, delimiter: str) -> Counts:
    lines = piece.decode("latin-1").split("\n")
    if lines and not lines[-1]:
        lines.pop()
    counts = [
        (len(split(line, delimiter)) if '"' in line or delimiter == " " else line.count(delimiter) + 1)
        if line.strip()
        else 0
        for line in lines
    ]
    return np.array(counts, dtype=np.int32)


def _usual(counts: Counts) -> int:
    return int(np.bincount(np.minimum(counts, 1 << 20)).argmax()) if len(counts) else 1
