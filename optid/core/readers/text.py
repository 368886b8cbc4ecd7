"""Text tables: CSV and similar files, and text exports of measurement programs, oscilloscopes and controllers.

`layout` finds where the table begins; here its rows are checked and the mapped columns read. Lines are counted here,
not by pandas, so that every error about a value can name its line, and no short row is filled silently.
"""

from __future__ import annotations

import codecs
import io
import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from optid.core.readers import loggers
from optid.core.readers.cells import MISSING, Unreadable, is_missing, is_stamp, numbers, unit_of, without_unit
from optid.core.readers.layout import (
    Layout,
    find_layout,
    has_decimal_comma,
    named_in_rows,
    split,
    unit_in,
    unreadable_row,
)
from optid.core.readers.limits import LONGEST_LINE, Budget, shown
from optid.core.readers.rows import Rows
from optid.core.readers.table import FORMATS, Column, Raw, Table
from optid.errors import RecordingError

if TYPE_CHECKING:
    import pandas as pd

_HEAD_LINES, _HEAD_BYTES = 3000, 8 << 20  # within which a table begins
_BINARY = re.compile(rb"[\x00-\x08\x0e-\x19\x1b-\x1f]")
_OLDER = ("latin-1", "cp1252", "cp1250", "cp1251", "cp932", "gb18030", "euc_kr", "big5", "mac_roman")
_QUOTED_LINES = re.compile(
    rb'(?:"(?:[^"\r\n]|"")*[,;\t](?:[^"\r\n]|"")*"\r?\n?)+'
)  # each line is one quoted cell
_QUOTES = re.compile(rb'(?m)^"(.*)"(?=\r?$)')
_SAMPLE = 2000  # rows looked at for a first guess of the decimal sign; the column itself decides


@dataclass(frozen=True)
class _Text:
    data: bytes  # in an encoding with one byte per character for all that structures a table
    encoding: str
    lines: tuple[str, ...]  # of the head


def read(data: bytes, path: Path, wanted: tuple[str, ...], budget: Budget) -> Table:
    """The requested columns of a text table, by name or as "column 3".

    Raises:
        RecordingError: not text, no table, a row of another length, a mapped column twice.
    """
    text = _decoded(data, wanted, path)
    layout = find_layout(text.lines, wanted)
    if layout is None:
        raise _no_table(text.lines, wanted, path)
    _refuse_long_table(text.lines, layout, wanted, path)
    logger = loggers.recognised(text.lines, layout)
    about = f"{logger.title}, whose table begins in line {layout.first + 1}" if logger else ""
    names = [name for name in layout.names if name]
    if not layout.found:
        return _nothing_found(layout, about, path)
    rows, encoding = Rows.of(text.data, text.encoding, layout, path), text.encoding
    del data, text  # a long file is in memory once
    place, notes = rows.lines.place, rows.notes
    notes += tuple(f'"{words}" is read as "{name}"' for name, words in layout.relaxed.items())
    read_cells = _cells(rows, layout, encoding, path)
    columns = {k: _column(cells, rows, layout, k, path) for k, cells in read_cells.items()}
    del rows, read_cells
    if logger is not None and logger.change is not None:
        columns, more = logger.change(layout, columns)
        notes += more
    chosen = {name: _chosen(name, indices, columns, layout, path) for name, indices in layout.found.items()}
    chosen = _own_clocks(layout, chosen, columns, wanted)
    return Table(chosen, names, "csv", about, {}, notes, place)


def _refuse_long_table(lines: Sequence[str], layout: Layout, wanted: Sequence[str], path: Path) -> None:
    missing = [name for name in wanted if name not in layout.found]
    if column := named_in_rows(lines, layout, missing):
        raise RecordingError(
            f'"{shown(missing[0])}" is not a column but a value of column "{shown(column)}": '
            "this is a long table with one value per row",
            where=path,
            expected="a column for each signal",
            hint=f'pivot it first, in pandas: table.pivot(index=TIME, columns="{shown(column)}", values=VALUE)',
        )


def _older_encoding(head: bytes, wanted: Sequence[str]) -> str:
    """The encoding of older exports: the one under which most of the mapped names occur; numbers are equal in all."""

    def seen(encoding: str) -> int:
        names = (name.encode(encoding, errors="ignore") for name in wanted if not name.isascii())
        return sum(bool(name) and name in head for name in names)

    return max(_OLDER, key=seen)


def _decoded(data: bytes, wanted: Sequence[str], path: Path) -> _Text:
    encoding = "utf-8"
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) or data[1:8:2] == b"\0\0\0\0":
        wide = "utf-16" if data[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE) else "utf-16-le"
        data = data.decode(wide, errors="replace").encode()
    data = data.removeprefix(codecs.BOM_UTF8)
    # Control characters other than tab, line ends and the old end-of-file mark do not occur in a table.
    if _BINARY.search(data[: 1 << 20]) or _BINARY.search(data[-(1 << 16) :]):
        raise RecordingError("this is neither text nor a known binary format", where=path, expected=FORMATS)
    head = data[:_HEAD_BYTES]
    if b"\n" not in head and b"\r" in head:
        data = data.replace(b"\r", b"\n")
        head = data[:_HEAD_BYTES]
    try:
        if not data.isascii():
            data.decode("utf-8")
    except UnicodeDecodeError:
        encoding = _older_encoding(head, wanted)
    if _QUOTED_LINES.fullmatch(head[: 1 << 16].rpartition(b"\n")[0]):
        data = _QUOTES.sub(lambda match: match[1].replace(b'""', b'"'), data)
        head = data[:_HEAD_BYTES]
    lines = head.split(b"\n")
    if len(head) < len(data) and len(lines) > 1:
        lines.pop()
    longest = max(map(len, lines))
    if longest > LONGEST_LINE:
        raise RecordingError(
            f"a line of {longest / 1e6:.3g} MB", where=path, expected="a table with a row on each line"
        )
    shown_lines = (line.decode(encoding, errors="replace").rstrip("\r") for line in lines[:_HEAD_LINES])
    return _Text(data, encoding, tuple(shown_lines))


def _no_table(lines: Sequence[str], wanted: Sequence[str], path: Path) -> RecordingError:
    if unreadable := unreadable_row(lines, wanted):
        header, row, name, cell = unreadable
        return RecordingError(
            f'line {row + 1} holds "{shown(cell)}", which is neither a number nor a time of day',
            where=path,
            field=f'column "{shown(name)}"',
            expected=f"rows of values below the names in line {header + 1}",
            hint=(
                "write numbers, or times such as 2024-05-02T10:00:00.001; for evenly spaced samples give the rate: "
                'rate = "1000 Hz"'
            ),
        )
    full = [i for i, line in enumerate(lines) if line.strip(" \t\x1a")]
    bare = [i for i in full if not lines[i].lstrip().startswith(("#", "%", "//"))]
    if not full:
        return RecordingError("the file is empty", where=path, expected=f"a table as {FORMATS}")
    if not bare:
        return RecordingError(
            "it holds only blank lines and comments", where=path, expected="a header and rows"
        )
    if len(bare) == 1:
        return RecordingError(f"only a header (line {bare[0] + 1})", where=path, expected="rows of numbers")
    place = f"line {bare[-1] + 1}" if len(bare) < _HEAD_LINES else "the file"
    return RecordingError(
        f"no rows of numbers as far as {place}",
        where=path,
        expected="a header line that names the columns, and rows of numbers below it",
    )


def _nothing_found(layout: Layout, about: str, path: Path) -> Table:
    if layout.header is None:
        raise RecordingError(
            f"line {layout.first + 1} holds numbers only, so no column has a name",
            where=path,
            expected="a header line",
            hint='add a line of names such as "t,u,x", or select columns by position: "column 1"',
        )
    about = (
        about
        or f"its table seems to begin in line {layout.first + 1} with the names in line {layout.header + 1}"
    )
    return Table({}, [name for name in layout.names if name], "csv", about)


def _cells(rows: Rows, layout: Layout, encoding: str, path: Path) -> dict[int, Raw]:
    """The mapped columns as pandas reads them: numbers where all cells are, else texts."""
    places = sorted({*layout.places, *loggers.clock_columns(layout)})
    sample = [split(line, layout.delimiter) for line in itertools.islice(rows.sample(), _SAMPLE)]
    options: dict[str, Any] = {
        "sep": r"\s+" if layout.delimiter == " " else layout.delimiter,
        "names": range(rows.widest),
        "usecols": places,
        "decimal": "," if has_decimal_comma(sample, places) else ".",
        "skip_blank_lines": rows.width > 1,  # a blank line in a single column is a missing sample
        "encoding": encoding,
    }
    try:
        found: dict[int, Raw] = {}
        at = 0
        for piece in rows.pieces():
            frame = _parsed(piece, options)
            if any(frame[k].dtype.kind not in "iufb" for k in places) or at + len(frame) > rows.count:
                whole = _parsed(rows.body, options)  # the whole column decides what its cells are
                return {k: whole[k].to_numpy() for k in places}
            for k in places:
                found[k] = _placed(found.get(k), frame[k].to_numpy(), at, rows.count)
            at += len(frame)
        return {k: column[:at] for k, column in found.items()}
    except (ValueError, OverflowError) as error:  # pandas raises ParserError, a ValueError
        reason = " ".join(str(error).split())[:160]
        raise RecordingError(f"the table cannot be read ({reason})", where=path) from None


def _placed(column: Raw | None, part: Raw, at: int, count: int) -> Raw:
    """A column with a part in its place; made once, of the kind that its parts need."""
    if column is None:
        column = np.zeros(count, dtype=part.dtype)
    kind = np.result_type(column, part)
    column = column if column.dtype == kind else column.astype(kind)
    column[at : at + len(part)] = part
    return column


def _parsed(piece: bytes, options: dict[str, Any]) -> pd.DataFrame:
    import pandas as pd

    frame: pd.DataFrame = pd.read_csv(
        io.BytesIO(piece),
        header=None,
        index_col=False,
        na_values=list(MISSING),
        keep_default_na=True,
        skipinitialspace=True,
        encoding_errors="replace",
        low_memory=False,
        **options,
    )
    return frame


def _column(cells: Raw, rows: Rows, layout: Layout, k: int, path: Path) -> Column:
    """A column whose cells are all numbers as such; stamps and texts as texts."""
    unit = _unit(layout, k)
    if cells.dtype.kind in "iufb":
        return Column(cells, unit=unit)
    cells = cells.astype(object)
    known = [
        cell
        for cell in itertools.islice(cells, 200)
        if isinstance(cell, str) and not is_missing(cell.strip())
    ]
    if known and all(is_stamp(cell.strip()) for cell in known):
        return Column(cells, unit=unit)
    if known and unit_of(known[0].strip()):
        cells, inside = without_unit(cells)
        unit = inside or unit
    comma = rows.decimal_comma(layout)
    try:
        return Column(numbers(cells, comma), unit=unit)
    except Unreadable as error:
        if k < len(layout.names) and error.found == layout.names[k]:
            raise RecordingError(
                f"{rows.lines.place(error.row)} repeats the header: the file holds several recordings",
                where=path,
                expected="one table",
                hint="cut the file there and pass the parts as separate recordings",
            ) from None
        if not error.ambiguous:
            return Column(cells, unit=unit)  # reported once its unit is known
        raise RecordingError(
            f'{rows.lines.place(error.row)} holds "{shown(error.found)}", which is ambiguous (thousands or decimals), '
            "as other columns have decimal commas",
            where=path,
            field=f'column "{shown(layout.names[k])}"',
            expected="one decimal sign",
            hint="export without a thousands separator",
        ) from None


def _unit(layout: Layout, k: int) -> str:
    inside = unit_in(layout.names[k]) if k < len(layout.names) else ""
    if inside:
        return inside
    for row in layout.between:
        cell = row[k].strip("()[]{} ") if k < len(row) else ""
        if cell and len(cell) < 12 and len(row) >= len(layout.names) - 1:
            return cell
    return ""


def _chosen(
    name: str, indices: tuple[int, ...], columns: dict[int, Column], layout: Layout, path: Path
) -> Column:
    """The one column of a name; several serve if they are alike."""
    first = columns[indices[0]]
    alike = all(_same(first.values, columns[k].values) for k in indices[1:])
    if alike or loggers.are_clocks(layout, indices):
        return first
    line = f"line {layout.header + 1}: " if layout.header is not None else ""
    places = " or ".join(f'"column {k + 1}"' for k in indices)
    raise RecordingError(
        f'{line}the column "{shown(name)}" occurs twice',
        where=path,
        expected="unique names",
        hint=f"select it by position: {places}",
    )


def _same(a: Raw, b: Raw) -> bool:
    if a.dtype.kind in "iufb" and b.dtype.kind in "iufb":
        return bool(np.array_equal(a.astype(float), b.astype(float), equal_nan=True))
    return a.dtype == b.dtype and all(x == y or (x != x and y != y) for x, y in zip(a, b, strict=True))


def _own_clocks(
    layout: Layout, chosen: dict[str, Column], columns: dict[int, Column], wanted: Sequence[str]
) -> dict[str, Column]:
    """Columns with the clock that stands before them, where the file has one before each."""
    clocks = loggers.clocks_before(layout)
    found = dict(chosen)
    for name in wanted:
        k = layout.found.get(name, (-1,))[0]
        if k in clocks and k not in clocks.values():
            found[name] = loggers.with_clock(chosen[name], columns[clocks[k]], layout)
    return found
