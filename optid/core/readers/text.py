"""Text tables: CSV with any delimiter, decimal point or comma, comments after # or %.

The first line that is neither blank nor a comment names the columns. Lines are counted here, not by
pandas, so that every complaint about a value can name its line, and no short row is filled up in silence.
"""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from optid.core.readers.table import FORMATS, Table
from optid.errors import RecordingError

_DELIMITERS = ("\t", ";", "|", ",", " ")  # " " stands for any run of blanks
_SAMPLE = 50  # lines looked at to find delimiter and decimal sign
_NUMBER = re.compile(r"[-+]?(\d+[.,]?\d*|[.,]\d+)([eE][-+]?\d+)?|[-+]?(inf|nan)", re.IGNORECASE)
_COMMA_NUMBER = re.compile(r"(?<![\w.,])[-+]?\d*,\d+(?![\d,]*,)")
_POINT_NUMBER = re.compile(r"\d\.\d|(?<!\w)\.\d")


def read(data: bytes, path: Path) -> Table:
    """Every column of a text table.

    Raises:
        RecordingError: not text, no header, no rows, two columns of one name, or a row of another length.
    """
    import pandas as pd

    lines = _decoded(data, path).replace("\r\n", "\n").replace("\r", "\n").split("\n")
    header, numbers, notes = _rows(lines, path)
    body = [lines[i] for i in numbers]
    delimiter = _delimiter(lines[header], body[:_SAMPLE])
    names = _names(_fields(lines[header], delimiter), header, path)
    if not body:
        raise RecordingError(f"only a header (line {header + 1})", where=path, expected="rows of numbers")
    width = _width(body, numbers, len(names), delimiter, path)
    names += [f"column {k + 1}" for k in range(len(names), width)]
    if width == 1:  # a blank line in a single column is a missing sample, not an empty line
        numbers = list(range(numbers[0], numbers[-1] + 1))
        numbers = [i for i in numbers if not _is_comment(lines[i])]
        body, notes = [lines[i].strip() or "nan" for i in numbers], ()
    try:
        frame = pd.read_csv(
            io.StringIO("\n".join(body)),
            sep=r"\s+" if delimiter == " " else delimiter,
            header=None,
            names=names,
            index_col=False,
            decimal="," if _decimal_comma(body[:_SAMPLE], delimiter) else ".",
            skipinitialspace=True,
            skip_blank_lines=False,
            low_memory=False,
        )
    except (ValueError, OverflowError) as error:  # pandas raises ParserError, a ValueError
        raise RecordingError(f"the table cannot be read ({error})", where=path) from None
    idle = [name for name in names if name.startswith("column ") and frame[name].isna().all()]
    frame = frame.drop(columns=idle)
    keep = frame.notna().any(axis="columns").to_numpy() if width > 1 else np.ones(len(frame), dtype=bool)
    if not keep.all():
        notes += (f"{int((~keep).sum())} rows without any value are left out",)
    places = np.array(numbers, dtype=np.int64)[keep] + 1
    return Table(frame[keep].reset_index(drop=True), "csv", places, notes=notes)


def _decoded(data: bytes, path: Path) -> str:
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return data.decode("utf-16", errors="replace")
    # Control characters other than tab, line ends and the old end-of-file mark do not occur in a table.
    if re.search(rb"[\x00-\x08\x0e-\x19\x1b-\x1f]", data):
        raise RecordingError("this is not text, nor a known binary format", where=path, expected=FORMATS)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")  # older exports: only names such as "µm" differ, numbers do not


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(("#", "%"))


def _rows(lines: Sequence[str], path: Path) -> tuple[int, list[int], tuple[str, ...]]:
    """Index of the header line, those of the data lines, and a note on blank lines among them."""
    full = [i for i, line in enumerate(lines) if line.strip(" \t\x1a") and not _is_comment(line)]
    if not full:
        raise RecordingError("nothing but blank lines and comments", where=path, expected="a header and rows")
    blank = sum(1 for line in lines[full[0] : full[-1]] if not line.strip())
    notes = (f"{blank} blank lines are left out",) if blank else ()
    return full[0], full[1:], notes


def _fields(line: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return [cell.strip('"') for cell in line.split()]
    return [
        cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [""])
    ]


def _count(line: str, delimiter: str) -> int:
    if '"' in line:
        return len(_fields(line, delimiter))
    return len(line.split()) if delimiter == " " else line.count(delimiter) + 1


def _delimiter(header: str, sample: Sequence[str]) -> str:
    """The delimiter for which most rows have as many fields as the header; the first of the list on a tie."""

    def agreement(delimiter: str) -> float:
        width = _count(header, delimiter)
        if width < 2:
            return -1.0
        return sum(_count(line, delimiter) in (width, width + 1) for line in sample) / max(len(sample), 1)

    best = max(_DELIMITERS, key=agreement)
    # One column: no delimiter agrees, and the comma in "0,5" is a decimal sign.
    return best if agreement(best) > 0 or (agreement(best) == 0 and sample) else ";"


def _decimal_comma(sample: Sequence[str], delimiter: str) -> bool:
    text = "\n".join(sample)
    return delimiter != "," and bool(_COMMA_NUMBER.search(text)) and not _POINT_NUMBER.search(text)


def _names(cells: list[str], line: int, path: Path) -> list[str]:
    filled = [cell for cell in cells if cell]
    if all(_NUMBER.fullmatch(cell) for cell in filled):
        raise RecordingError(
            f"line {line + 1} holds numbers only, so no column has a name", where=path,
            expected="a header line", hint='write the names first, such as "t,u,x"',
        )  # fmt: skip
    twice = [name for name, times in Counter(filled).items() if times > 1]
    if twice:
        raise RecordingError(
            f'line {line + 1}: the column "{twice[0]}" stands twice', where=path, expected="unique names"
        )
    return [cell or f"column {k + 1}" for k, cell in enumerate(cells)]


def _width(body: Sequence[str], numbers: Sequence[int], width: int, delimiter: str, path: Path) -> int:
    """Fields a row has: as many as the header, or one more where every row ends in a delimiter."""
    counts = [_count(line, delimiter) for line in body]
    if (
        delimiter != " "
        and all(c == width + 1 for c in counts)
        and all(line.rstrip(" ").endswith(delimiter) for line in body)
    ):
        return width + 1
    for number, count in zip(numbers, counts, strict=True):
        if count != width:
            last = number == numbers[-1]
            raise RecordingError(
                f"line {number + 1} has {count} {'field' if count == 1 else 'fields'}", where=path,
                expected=f"{width}, as in the header",
                hint="the file may be truncated" if last else None,
            )  # fmt: skip
    return width
